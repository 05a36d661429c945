//! What is drawn of one hierarchy, whatever its form.

use mullion_common::scene::{ClusterHierarchy, GroupId, Hierarchy, VertexHierarchy, VertexId};

use super::cluster_cut::ClusterCut;
use super::steps::StepId;
use super::vertex_cut::VertexCut;

/// An active cut of one hierarchy: a set of steps, each with all that it needs; or nothing at all.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub enum Cut {
    Vertices(VertexCut),
    Clusters(ClusterCut),
}

impl Cut {
    /// The base of a hierarchy.
    pub fn new(hierarchy: &Hierarchy) -> Self {
        match hierarchy {
            Hierarchy::Vertices(hierarchy) => Self::Vertices(VertexCut::new(hierarchy)),
            Hierarchy::Clusters(hierarchy) => Self::Clusters(ClusterCut::new(hierarchy)),
        }
    }

    /// Takes all of it away: the base, too.
    pub fn vanish(&mut self) {
        match self {
            Self::Vertices(cut) => cut.vanish(),
            Self::Clusters(cut) => cut.vanish(),
        }
    }

    /// How many triangles are there.
    pub fn triangle_count(&self) -> u32 {
        match self {
            Self::Vertices(cut) => cut.triangle_count(),
            Self::Clusters(cut) => cut.triangle_count(),
        }
    }

    /// Makes all steps of a set that has whatever any of it needs, and takes back all others. `steps` are the set, in any order. A cut of another
    /// form begins anew; blocks may have come since.
    pub fn follow(&mut self, hierarchy: &Hierarchy, steps: &[StepId], is_chosen: impl Fn(StepId) -> bool) {
        match (&mut *self, hierarchy) {
            (Self::Vertices(cut), Hierarchy::Vertices(hierarchy)) => {
                cut.grow(hierarchy);
                cut.follow(hierarchy, steps.iter().map(|step| step.lead()), |lead: VertexId| is_chosen(StepId(lead.0)));
            }
            (Self::Clusters(cut), Hierarchy::Clusters(hierarchy)) => {
                cut.grow(hierarchy);
                cut.follow(hierarchy, steps.iter().map(|step| step.group()), |group: GroupId| is_chosen(StepId(group.0)));
            }
            _ => {
                *self = Self::new(hierarchy);
                self.follow(hierarchy, steps, is_chosen);
            }
        }
    }

    /// The vertices that are there, by numbers in the hierarchy; clusters have their own.
    pub fn vertices<'a>(&'a self, hierarchy: &'a Hierarchy) -> impl Iterator<Item = u32> + 'a {
        let of_vertices = self.as_vertices(hierarchy).into_iter().flat_map(|(cut, _)| cut.vertices().map(|v| v.0));
        let of_clusters = self.as_clusters(hierarchy).into_iter().flat_map(|(cut, hierarchy)| {
            cut.clusters().iter().flat_map(|cluster| hierarchy.cluster_vertices(*cluster).iter().copied())
        });
        of_vertices.chain(of_clusters)
    }

    /// The triangles that are there, counterclockwise from the front, each vertex by its place among [`Cut::vertices`]. All three are of one part.
    pub fn placed_triangles<'a>(&'a self, hierarchy: &'a Hierarchy) -> impl Iterator<Item = [u32; 3]> + 'a {
        let of_vertices = self.as_vertices(hierarchy).into_iter().flat_map(|(cut, hierarchy)| cut.placed_triangles(hierarchy));
        let of_clusters = self.as_clusters(hierarchy).into_iter().flat_map(|(cut, hierarchy)| {
            let mut end = 0;
            cut.clusters().iter().flat_map(move |cluster| {
                let first = end;
                end += hierarchy.cluster_vertices(*cluster).len() as u32;
                hierarchy.local_triangles(*cluster).iter().map(move |t| t.map(|place| first + u32::from(place)))
            })
        });
        of_vertices.chain(of_clusters)
    }

    /// The cut and its hierarchy, if both are of vertices.
    fn as_vertices<'a>(&'a self, hierarchy: &'a Hierarchy) -> Option<(&'a VertexCut, &'a VertexHierarchy)> {
        match (self, hierarchy) {
            (Self::Vertices(cut), Hierarchy::Vertices(hierarchy)) => Some((cut, hierarchy)),
            _ => None,
        }
    }

    /// The cut and its hierarchy, if both are of clusters.
    fn as_clusters<'a>(&'a self, hierarchy: &'a Hierarchy) -> Option<(&'a ClusterCut, &'a ClusterHierarchy)> {
        match (self, hierarchy) {
            (Self::Clusters(cut), Hierarchy::Clusters(hierarchy)) => Some((cut, hierarchy)),
            _ => None,
        }
    }
}

impl Default for Cut {
    fn default() -> Self {
        Self::Vertices(VertexCut::default())
    }
}
