//! What refinement asks of a hierarchy, whatever its form.

use std::ops::Range;

use glam::Vec3;
use mullion_common::scene::{ClusterHierarchy, GroupId, Hierarchy, PackedBounds, VertexHierarchy, VertexId};

/// What is refined at once: a lead's split with whatever splits together with it, or a group of clusters. By the lead or the group.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct StepId(pub u32);

impl StepId {
    /// As an index.
    pub fn index(self) -> usize {
        self.0 as usize
    }

    /// Of a vertex hierarchy.
    pub fn lead(self) -> VertexId {
        VertexId(self.0)
    }

    /// Of a cluster hierarchy.
    pub fn group(self) -> GroupId {
        GroupId(self.0)
    }
}

/// The steps of a hierarchy, as far as it is there.
pub(super) trait Steps {
    /// No step has so high a number.
    fn end(&self) -> u32;

    /// Triangles before any step.
    fn base_triangles(&self) -> u32;

    /// Steps that nothing comes before, each with the vertex that splits, if one does.
    fn for_first(&self, with: impl FnMut(VertexId, StepId));

    /// Steps that must be made before one, each by one of its numbers, some more than once.
    fn for_needs(&self, step: StepId, with: impl FnMut(StepId));

    /// The step that a number is of.
    fn named(&self, number: StepId) -> StepId;

    /// All numbers of a step, its own first.
    fn numbers(&self, step: StepId) -> Range<u32>;

    /// How many triangles a step adds.
    fn added_triangles(&self, step: StepId) -> u32;

    /// What encloses whatever comes of a step, about a middle; `parent` is the vertex that splits.
    fn packed_bounds(&self, parent: VertexId, step: StepId) -> (Vec3, &PackedBounds);
}

impl Steps for VertexHierarchy {
    fn end(&self) -> u32 {
        self.vertex_count()
    }

    fn base_triangles(&self) -> u32 {
        self.base().triangles.len() as u32
    }

    fn for_first(&self, mut with: impl FnMut(VertexId, StepId)) {
        let splits = (0..self.base_count()).map(VertexId).filter_map(|v| Some((v, self.first_child(v)?)));
        splits.for_each(|(parent, lead)| with(parent, StepId(lead.0)));
    }

    #[inline]
    fn for_needs(&self, step: StepId, mut with: impl FnMut(StepId)) {
        for vertex in self.together(step.lead()) {
            let is_split = |v: &&u32| !self.is_base(VertexId(**v));
            self.link(vertex).path().iter().filter(is_split).for_each(|v| with(StepId(*v)));
        }
    }

    #[inline]
    fn named(&self, number: StepId) -> StepId {
        StepId(self.lead(number.lead()).0)
    }

    #[inline]
    fn numbers(&self, step: StepId) -> Range<u32> {
        step.0..step.0 + self.together(step.lead()).count() as u32
    }

    #[inline]
    fn added_triangles(&self, step: StepId) -> u32 {
        self.added_triangles(step.lead())
    }

    #[inline]
    fn packed_bounds(&self, parent: VertexId, step: StepId) -> (Vec3, &PackedBounds) {
        (self.position(parent), self.packed_bounds(step.lead()))
    }
}

impl Steps for ClusterHierarchy {
    fn end(&self) -> u32 {
        self.group_count()
    }

    fn base_triangles(&self) -> u32 {
        self.root_triangles()
    }

    fn for_first(&self, mut with: impl FnMut(VertexId, StepId)) {
        self.first_groups().iter().for_each(|group| with(VertexId(0), StepId(group.0)));
    }

    #[inline]
    fn for_needs(&self, step: StepId, mut with: impl FnMut(StepId)) {
        self.needs(step.group()).iter().for_each(|group| with(StepId(group.0)));
    }

    #[inline]
    fn named(&self, number: StepId) -> StepId {
        number
    }

    #[inline]
    fn numbers(&self, step: StepId) -> Range<u32> {
        step.0..step.0 + 1
    }

    #[inline]
    fn added_triangles(&self, step: StepId) -> u32 {
        self.added_triangles(step.group())
    }

    #[inline]
    fn packed_bounds(&self, _: VertexId, step: StepId) -> (Vec3, &PackedBounds) {
        self.packed_bounds(step.group())
    }
}

impl Steps for Hierarchy {
    fn end(&self) -> u32 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.end(),
            Self::Clusters(hierarchy) => hierarchy.end(),
        }
    }

    fn base_triangles(&self) -> u32 {
        match self {
            Self::Vertices(hierarchy) => hierarchy.base_triangles(),
            Self::Clusters(hierarchy) => hierarchy.base_triangles(),
        }
    }

    fn for_first(&self, with: impl FnMut(VertexId, StepId)) {
        match self {
            Self::Vertices(hierarchy) => hierarchy.for_first(with),
            Self::Clusters(hierarchy) => hierarchy.for_first(with),
        }
    }

    #[inline]
    fn for_needs(&self, step: StepId, with: impl FnMut(StepId)) {
        match self {
            Self::Vertices(hierarchy) => hierarchy.for_needs(step, with),
            Self::Clusters(hierarchy) => hierarchy.for_needs(step, with),
        }
    }

    #[inline]
    fn named(&self, number: StepId) -> StepId {
        match self {
            Self::Vertices(hierarchy) => hierarchy.named(number),
            Self::Clusters(hierarchy) => hierarchy.named(number),
        }
    }

    #[inline]
    fn numbers(&self, step: StepId) -> Range<u32> {
        match self {
            Self::Vertices(hierarchy) => hierarchy.numbers(step),
            Self::Clusters(hierarchy) => hierarchy.numbers(step),
        }
    }

    #[inline]
    fn added_triangles(&self, step: StepId) -> u32 {
        match self {
            Self::Vertices(hierarchy) => Steps::added_triangles(hierarchy, step),
            Self::Clusters(hierarchy) => Steps::added_triangles(hierarchy, step),
        }
    }

    #[inline]
    fn packed_bounds(&self, parent: VertexId, step: StepId) -> (Vec3, &PackedBounds) {
        match self {
            Self::Vertices(hierarchy) => Steps::packed_bounds(hierarchy, parent, step),
            Self::Clusters(hierarchy) => Steps::packed_bounds(hierarchy, parent, step),
        }
    }
}
