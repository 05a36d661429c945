//! A wall drawn with occlusion culling beside the same without.

use std::path::Path;

use anyhow::Result;
use glam::{DAffine3, DVec3};
use mullion_client::frame::Planner;
use mullion_client::occlusion::Occlusion;
use mullion_client::output::headless::write_png;
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{ViewId, Wall};
use mullion_server::cull::{Algorithm, Culler};
use mullion_server::tree::CullTree;
use serde::Serialize;

use super::{Composite, Painter, Picture, Pose, difference};

/// Steps before a pose: nothing is known in the first frame, and in the last nothing moves.
const STEPS_BEFORE: [f64; 4] = [2.0, 1.0, 0.0, 0.0];
/// Metres of the room between two frames.
const STEP_M: f64 = 0.1;

/// What was found of one way to leave out what is hidden, over all grids, eyes and frames.
#[derive(Clone, Debug, Serialize)]
pub struct OcclusionVerdict {
    pub occlusion: &'static str,
    /// Tiles drawn with and without.
    pub tiles_compared: u32,
    /// Leaves in the tiles' sets.
    pub leaves_in_sets: u64,
    /// Of them, those that were not drawn. 0: the check is about nothing.
    pub leaves_left_out: u64,
    /// Tiles whose colours or objects are not the same, bit for bit.
    pub tiles_that_differ: u32,
    /// Their pixels that are not the same.
    pub pixels_that_differ: u64,
    /// Over all walls, the greatest share of pixels that are not the same.
    pub worst_differing_percent: f64,
}

impl OcclusionVerdict {
    pub fn new(occlusion: Occlusion) -> Self {
        Self {
            occlusion: occlusion.name(),
            tiles_compared: 0,
            leaves_in_sets: 0,
            leaves_left_out: 0,
            tiles_that_differ: 0,
            pixels_that_differ: 0,
            worst_differing_percent: 0.0,
        }
    }

    /// Whether no pixel changed.
    pub fn holds(&self) -> bool {
        self.tiles_that_differ == 0
    }

    pub fn left_out_percent(&self) -> f64 {
        if self.leaves_in_sets == 0 { 0.0 } else { 100.0 * self.leaves_left_out as f64 / self.leaves_in_sets as f64 }
    }

    fn note_tile(&mut self, [plain, culled]: [&Picture; 2], set: &VisibleSet, drawn: &VisibleSet) {
        let mut left_out = VisibleSet::default();
        set.difference_into(drawn, &mut left_out);
        self.leaves_in_sets += u64::from(set.len());
        self.leaves_left_out += u64::from(left_out.len());
        let differing = plain.differing_from(culled);
        self.tiles_compared += 1;
        self.tiles_that_differ += u32::from(differing > 0);
        self.pixels_that_differ += differing;
    }
}

/// A wall and where its tiles are drawn.
pub struct Subject<'a> {
    pub wall: &'a Wall,
    pub target: ViewId,
    pub tree: &'a CullTree,
    pub algorithm: Algorithm,
    pub pose: &'a Pose,
}

/// One way to draw all tiles, each from what it saw in the frame before.
struct Contestant<'a> {
    occlusion: Occlusion,
    planners: Vec<Planner>,
    verdict: &'a mut OcclusionVerdict,
    composite: Composite,
}

/// Walks to a pose in a few frames, and draws each without occlusion culling and in every way. `pictures`: where composites that differ go,
/// and how their names begin.
pub fn check(
    painter: &mut Painter<'_>,
    subject: &Subject<'_>,
    ways: &[Occlusion],
    verdicts: &mut [OcclusionVerdict],
    pictures: Option<(&Path, &str)>,
) -> Result<()> {
    let Subject { wall, target, tree, algorithm, pose } = *subject;
    let views = wall.views();
    let contestant = |(occlusion, verdict)| {
        let planners = views.iter().map(|_| Planner::new().culling(occlusion)).collect();
        Contestant { occlusion, planners, verdict, composite: Composite::new() }
    };
    let mut contestants: Vec<Contestant<'_>> = ways.iter().copied().zip(verdicts).map(contestant).collect();
    let mut culler = Culler::new(algorithm, wall);
    let (eyes, mut sets) = (vec![pose.eye; views.len()], vec![VisibleSet::default(); views.len()]);
    let mut plain_wall = Composite::new();
    for (frame, steps) in STEPS_BEFORE.into_iter().enumerate() {
        let world_from_room = pose.world_from_room * DAffine3::from_translation(DVec3::Z * (steps * STEP_M));
        sets.iter_mut().for_each(VisibleSet::clear);
        culler.cull(tree, wall, &eyes, &world_from_room, &mut sets);
        for (at, set) in sets.iter().enumerate() {
            let projection = wall.projection(ViewId(at as u16), pose.eye, &world_from_room);
            let place = wall.tile(views[at].tile).place;
            let plain = painter.draw(target, projection, set)?;
            plain_wall.place(&plain, place);
            for Contestant { planners, verdict, composite, .. } in &mut contestants {
                let (culled, drawn) = painter.draw_with(&mut planners[at], target, projection, set)?;
                verdict.note_tile([&plain, &culled], set, &drawn);
                composite.place(&culled, place);
            }
        }
        for Contestant { occlusion, verdict, composite, .. } in &mut contestants {
            let differing = plain_wall.0.differing_from(&composite.0);
            let percent = 100.0 * differing as f64 / plain_wall.0.ids.len() as f64;
            verdict.worst_differing_percent = verdict.worst_differing_percent.max(percent);
            if let (Some((folder, stem)), true) = (pictures, differing > 0) {
                let stem = format!("{stem}-{occlusion}-frame{frame}");
                write_png(&folder.join(format!("{stem}-composite.png")), &composite.0.color)?;
                let difference = difference(&composite.0.color, &plain_wall.0.color, 0);
                write_png(&folder.join(format!("{stem}-difference.png")), &difference)?;
            }
        }
    }
    Ok(())
}
