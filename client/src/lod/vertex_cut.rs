//! vertex_front: which vertices of one hierarchy are there, and the triangles between them.

use mullion_common::scene::{TrianglePlace, VertexHierarchy, VertexId};

use super::sparse::Sparse;

const NONE: u32 = u32::MAX;

/// What is known of a vertex that is there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    pub vertex: VertexId,
    /// Which of the triangles that it made are there: a bit each. Nothing for vertices of the base.
    triangles: u32,
    /// Splits that were made and need it.
    needed: u32,
}

/// An active cut of one hierarchy: a set of splits, each with all that it needs; or nothing at all. Starts as the base.
#[derive(Clone, Debug)]
pub struct VertexCut {
    /// For each vertex its place in `slots`.
    places: Sparse<u32>,
    slots: Vec<Slot>,
    base_triangles: Vec<u64>,
    base_count: u32,
    triangle_count: u32,
    is_nothing: bool,
    /// What is split or taken back next.
    changes: Vec<VertexId>,
}

impl Default for VertexCut {
    fn default() -> Self {
        Self {
            places: Sparse::new(NONE),
            slots: Vec::new(),
            base_triangles: Vec::new(),
            base_count: 0,
            triangle_count: 0,
            is_nothing: true,
            changes: Vec::new(),
        }
    }
}

impl VertexCut {
    /// The base of a hierarchy.
    pub fn new(hierarchy: &VertexHierarchy) -> Self {
        let mut cut = Self::default();
        cut.reset(hierarchy);
        cut
    }

    /// Takes all splits back. Another hierarchy may be given; memory is taken only where it is larger.
    pub fn reset(&mut self, hierarchy: &VertexHierarchy) {
        let count = hierarchy.base_count();
        self.vanish();
        self.is_nothing = false;
        self.grow(hierarchy);
        self.base_count = count;
        let base = &hierarchy.base().triangles;
        self.base_triangles.clear();
        self.base_triangles.resize(base.len().div_ceil(64), u64::MAX);
        self.triangle_count = base.len() as u32;
        (0..count).for_each(|v| self.put(VertexId(v)));
    }

    /// Takes all of it away: the base, too.
    pub fn vanish(&mut self) {
        self.slots.drain(..).for_each(|slot| *self.places.get_mut(slot.vertex.index()) = NONE);
        (self.base_count, self.triangle_count, self.is_nothing) = (0, 0, true);
    }

    /// Makes room for blocks that came since.
    pub fn grow(&mut self, hierarchy: &VertexHierarchy) {
        self.places.grow(hierarchy.vertex_count() as usize);
    }

    fn put(&mut self, vertex: VertexId) {
        *self.places.get_mut(vertex.index()) = self.slots.len() as u32;
        self.slots.push(Slot { vertex, triangles: 0, needed: 0 });
    }

    fn remove(&mut self, vertex: VertexId) {
        let place = std::mem::replace(self.places.get_mut(vertex.index()), NONE);
        self.slots.swap_remove(place as usize);
        if let Some(moved) = self.slots.get(place as usize) {
            *self.places.get_mut(moved.vertex.index()) = place;
        }
    }

    /// Whether a vertex is there.
    #[inline]
    pub fn has(&self, vertex: VertexId) -> bool {
        self.place(vertex) != NONE
    }

    fn slot(&self, vertex: VertexId) -> Option<&Slot> {
        self.slots.get(self.place(vertex) as usize)
    }

    fn slot_mut(&mut self, vertex: VertexId) -> Option<&mut Slot> {
        let place = self.place(vertex);
        self.slots.get_mut(place as usize)
    }

    /// The vertices that are there, by their places. Ascending, if nothing was split or taken back since [`VertexCut::follow`].
    pub fn vertices(&self) -> impl ExactSizeIterator<Item = VertexId> {
        self.slots.iter().map(|slot| slot.vertex)
    }

    /// The place of a vertex that is there among [`VertexCut::vertices`].
    #[inline]
    pub fn place(&self, vertex: VertexId) -> u32 {
        self.places.get(vertex.index())
    }

    /// How many triangles are there.
    pub fn triangle_count(&self) -> u32 {
        self.triangle_count
    }

    fn change_needed(&mut self, hierarchy: &VertexHierarchy, lead: VertexId, by: u32) {
        for vertex in hierarchy.together(lead) {
            for needed in hierarchy.link(vertex).path() {
                if let Some(slot) = self.slot_mut(VertexId(*needed)) {
                    slot.needed = slot.needed.wrapping_add(by);
                }
            }
        }
    }

    /// Makes a split, with whatever goes together with it. Its link must be there, and it must not. How many triangles came.
    ///
    /// # Panics
    /// When the link is not there.
    pub fn split(&mut self, hierarchy: &VertexHierarchy, lead: VertexId) -> u32 {
        self.change_needed(hierarchy, lead, 1);
        let before = self.triangle_count;
        for vertex in hierarchy.together(lead) {
            let link = hierarchy.link(vertex);
            for (a, b) in link.floor() {
                let place =
                    self.find(hierarchy, [link.parent(), a, b], true).expect("a split finds what it takes: its link is there");
                self.set(hierarchy, place, false);
            }
            self.put(vertex);
            let all = ((1u64 << link.edges().len()) - 1) as u32;
            if let Some(slot) = self.slot_mut(vertex) {
                slot.triangles = all;
            }
            self.triangle_count += link.edges().len() as u32;
        }
        self.triangle_count - before
    }

    /// Whether a split can be taken back: it was made, and no other needs it.
    #[inline]
    pub fn can_collapse(&self, hierarchy: &VertexHierarchy, lead: VertexId) -> bool {
        !hierarchy.is_base(lead) && hierarchy.together(lead).all(|vertex| self.slot(vertex).is_some_and(|slot| slot.needed == 0))
    }

    /// Takes a split back, with whatever went together with it. How many triangles are gone.
    ///
    /// # Panics
    /// When another split needs it.
    pub fn collapse(&mut self, hierarchy: &VertexHierarchy, lead: VertexId) -> u32 {
        assert!(self.can_collapse(hierarchy, lead), "a split is taken back that others need");
        let before = self.triangle_count;
        for vertex in hierarchy.together(lead) {
            let link = hierarchy.link(vertex);
            self.triangle_count -= link.edges().len() as u32;
            self.remove(vertex);
            for (a, b) in link.floor() {
                let place = self.find(hierarchy, [link.parent(), a, b], false).expect("what a split took can come back");
                self.set(hierarchy, place, true);
            }
        }
        self.change_needed(hierarchy, lead, u32::MAX);
        before - self.triangle_count
    }

    /// Makes all splits of a set that has whatever any of it needs, and takes back all others. `leads` are the set, in any order. Vertices then
    /// ascend: where triangles coincide, the same one is drawn first whatever was followed before.
    pub fn follow(
        &mut self,
        hierarchy: &VertexHierarchy,
        leads: impl Iterator<Item = VertexId>,
        is_chosen: impl Fn(VertexId) -> bool,
    ) {
        if self.is_nothing {
            self.reset(hierarchy);
        }
        let mut changes = std::mem::take(&mut self.changes);
        // What a vertex follows is in its record: of those that stay nobody need look there.
        let goes = |v: VertexId| !hierarchy.is_base(v) && !is_chosen(v) && !hierarchy.is_follower(v);
        changes.clear();
        changes.extend(self.slots.iter().map(|slot| slot.vertex).filter(|v| goes(*v)));
        // What a split needs has lower numbers.
        changes.sort_unstable();
        let mut has_changed = !changes.is_empty();
        changes.drain(..).rev().for_each(|lead| {
            self.collapse(hierarchy, lead);
        });
        changes.extend(leads.filter(|lead| !self.has(*lead)));
        has_changed |= !changes.is_empty();
        changes.sort_unstable();
        changes.drain(..).for_each(|lead| {
            self.split(hierarchy, lead);
        });
        self.changes = changes;
        if has_changed {
            self.slots.sort_unstable_by_key(|slot| slot.vertex);
            (0..).zip(&self.slots).for_each(|(place, slot)| *self.places.get_mut(slot.vertex.index()) = place);
        }
    }

    /// A triangle of these vertices that is there, or that is not.
    #[inline]
    fn find(&self, hierarchy: &VertexHierarchy, corners: [u32; 3], there: bool) -> Option<TrianglePlace> {
        hierarchy.places(corners).find(|place| self.is_there(hierarchy, *place) == there)
    }

    #[inline]
    fn is_there(&self, hierarchy: &VertexHierarchy, place: TrianglePlace) -> bool {
        if hierarchy.is_base(place.maker) {
            let at = hierarchy.base_range(place.maker).start + place.number as usize;
            self.base_triangles[at / 64] >> (at % 64) & 1 != 0
        } else {
            self.slot(place.maker).is_some_and(|slot| slot.triangles >> place.number & 1 != 0)
        }
    }

    /// Puts a triangle or takes it; the counts are those of triangles that are there.
    #[inline]
    fn set(&mut self, hierarchy: &VertexHierarchy, place: TrianglePlace, there: bool) {
        if hierarchy.is_base(place.maker) {
            let at = hierarchy.base_range(place.maker).start + place.number as usize;
            let word = &mut self.base_triangles[at / 64];
            *word = *word & !(1 << (at % 64)) | u64::from(there) << (at % 64);
        } else if let Some(slot) = self.slot_mut(place.maker) {
            slot.triangles = slot.triangles & !(1 << place.number) | u32::from(there) << place.number;
        }
        self.triangle_count = if there { self.triangle_count + 1 } else { self.triangle_count - 1 };
    }

    /// The triangles that are there, counterclockwise from the front. The first of each tells its material.
    pub fn triangles<'a>(&'a self, hierarchy: &'a VertexHierarchy) -> impl Iterator<Item = [VertexId; 3]> + 'a {
        self.base_triangles(hierarchy).chain(self.slots.iter().flat_map(move |slot| slot.triangles(hierarchy)))
    }

    /// The same, each vertex by its place among [`VertexCut::vertices`].
    pub fn placed_triangles<'a>(&'a self, hierarchy: &'a VertexHierarchy) -> impl Iterator<Item = [u32; 3]> + 'a {
        let of_base = self.base_triangles(hierarchy).map(|t| t.map(|vertex| self.place(vertex)));
        let made = (0..)
            .zip(&self.slots)
            .flat_map(move |(place, slot)| slot.triangles(hierarchy).map(move |[_, a, b]| [place, self.place(a), self.place(b)]));
        of_base.chain(made)
    }

    fn base_triangles<'a>(&'a self, hierarchy: &'a VertexHierarchy) -> impl Iterator<Item = [VertexId; 3]> + 'a {
        let base = hierarchy.base().triangles.iter().take(if self.is_nothing { 0 } else { usize::MAX }).enumerate();
        base.filter(|(at, _)| self.base_triangles[at / 64] >> (at % 64) & 1 != 0).map(|(_, t)| t.map(VertexId))
    }
}

impl Slot {
    /// Those that its vertex made and that are there, the vertex first.
    #[inline]
    fn triangles(&self, hierarchy: &VertexHierarchy) -> impl Iterator<Item = [VertexId; 3]> {
        let (vertex, mut left) = (self.vertex, self.triangles);
        let link = (left != 0).then(|| hierarchy.link(vertex));
        std::iter::from_fn(move || {
            let (link, number) = (link.filter(|_| left != 0)?, left.trailing_zeros());
            left &= left - 1;
            let (a, b) = link.edge(number);
            Some([vertex, VertexId(a), VertexId(b)])
        })
    }
}
