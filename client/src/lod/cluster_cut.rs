//! Which groups of one cluster hierarchy are refined, and the clusters that are drawn for it.

use mullion_common::scene::{ClusterHierarchy, ClusterId, GroupId};

use super::sparse::Sparse;

const NONE: u32 = u32::MAX;

/// An active cut of one hierarchy: a closed set of refined groups; or nothing at all. Starts as the roots.
#[derive(Clone, Debug)]
pub struct ClusterCut {
    /// For each group its place in `refined`.
    group_places: Sparse<u32>,
    refined: Vec<GroupId>,
    /// For each cluster its place in `drawn`.
    places: Sparse<u32>,
    drawn: Vec<ClusterId>,
    triangle_count: u32,
    is_nothing: bool,
    /// What is refined or taken back next.
    changes: Vec<GroupId>,
}

impl Default for ClusterCut {
    fn default() -> Self {
        Self {
            group_places: Sparse::new(NONE),
            refined: Vec::new(),
            places: Sparse::new(NONE),
            drawn: Vec::new(),
            triangle_count: 0,
            is_nothing: true,
            changes: Vec::new(),
        }
    }
}

impl ClusterCut {
    /// The roots of a hierarchy.
    pub fn new(hierarchy: &ClusterHierarchy) -> Self {
        let mut cut = Self::default();
        cut.reset(hierarchy);
        cut
    }

    /// Takes all back to the roots. Another hierarchy may be given; memory is taken only where it is larger.
    pub fn reset(&mut self, hierarchy: &ClusterHierarchy) {
        self.vanish();
        self.is_nothing = false;
        self.grow(hierarchy);
        hierarchy.roots().for_each(|root| put(&mut self.places, &mut self.drawn, root, ClusterId::index));
        self.triangle_count = hierarchy.root_triangles();
    }

    /// Takes all of it away: the roots, too.
    pub fn vanish(&mut self) {
        self.refined.drain(..).for_each(|group| *self.group_places.get_mut(group.index()) = NONE);
        self.drawn.drain(..).for_each(|cluster| *self.places.get_mut(cluster.index()) = NONE);
        (self.triangle_count, self.is_nothing) = (0, true);
    }

    /// Makes room for blocks that came since.
    pub fn grow(&mut self, hierarchy: &ClusterHierarchy) {
        self.group_places.grow(hierarchy.group_count() as usize);
        self.places.grow(hierarchy.cluster_count() as usize);
    }

    /// Whether a group is refined.
    #[inline]
    pub fn is_refined(&self, group: GroupId) -> bool {
        self.group_places.get(group.index()) != NONE
    }

    /// The refined groups, in any order.
    pub fn groups(&self) -> &[GroupId] {
        &self.refined
    }

    /// The clusters that are drawn, ascending.
    pub fn clusters(&self) -> &[ClusterId] {
        &self.drawn
    }

    /// How many triangles they have.
    pub fn triangle_count(&self) -> u32 {
        self.triangle_count
    }

    /// Refines all groups of a closed set, and takes back all others. `groups` are the set, in any order. What a set draws that is not closed
    /// means nothing.
    pub fn follow(
        &mut self,
        hierarchy: &ClusterHierarchy,
        groups: impl Iterator<Item = GroupId>,
        is_chosen: impl Fn(GroupId) -> bool,
    ) {
        if self.is_nothing {
            self.reset(hierarchy);
        }
        let mut changes = std::mem::take(&mut self.changes);
        changes.clear();
        changes.extend(self.refined.iter().filter(|group| !is_chosen(**group)));
        // What a group needs has lower numbers.
        changes.sort_unstable();
        let mut has_changed = !changes.is_empty();
        changes.drain(..).rev().for_each(|group| self.coarsen(hierarchy, group));
        changes.extend(groups.filter(|group| !self.is_refined(*group)));
        has_changed |= !changes.is_empty();
        changes.sort_unstable();
        changes.drain(..).for_each(|group| self.refine(hierarchy, group));
        self.changes = changes;
        if has_changed {
            // Where triangles coincide, the same one is drawn first whatever was followed before.
            self.drawn.sort_unstable();
            (0..).zip(&self.drawn).for_each(|(place, cluster)| *self.places.get_mut(cluster.index()) = place);
        }
    }

    fn refine(&mut self, hierarchy: &ClusterHierarchy, group: GroupId) {
        put(&mut self.group_places, &mut self.refined, group, GroupId::index);
        hierarchy.results(group).iter().for_each(|result| take(&mut self.places, &mut self.drawn, *result, ClusterId::index));
        hierarchy.members(group).for_each(|member| put(&mut self.places, &mut self.drawn, member, ClusterId::index));
        self.triangle_count += hierarchy.added_triangles(group);
    }

    fn coarsen(&mut self, hierarchy: &ClusterHierarchy, group: GroupId) {
        take(&mut self.group_places, &mut self.refined, group, GroupId::index);
        hierarchy.members(group).for_each(|member| take(&mut self.places, &mut self.drawn, member, ClusterId::index));
        hierarchy.results(group).iter().for_each(|result| put(&mut self.places, &mut self.drawn, *result, ClusterId::index));
        self.triangle_count -= hierarchy.added_triangles(group);
    }
}

/// Puts something where it is not.
fn put<T: Copy>(places: &mut Sparse<u32>, items: &mut Vec<T>, item: T, index: fn(T) -> usize) {
    let place = places.get_mut(index(item));
    if *place == NONE {
        *place = items.len() as u32;
        items.push(item);
    }
}

/// Takes something from where it is.
fn take<T: Copy>(places: &mut Sparse<u32>, items: &mut Vec<T>, item: T, index: fn(T) -> usize) {
    let place = std::mem::replace(places.get_mut(index(item)), NONE);
    if place != NONE {
        items.swap_remove(place as usize);
        if let Some(moved) = items.get(place as usize) {
            *places.get_mut(index(*moved)) = place;
        }
    }
}
