//! The Occlusion Unit counts the same on the CPU and on the GPU, to the bit, and its polygons are what boxes cover.
//! Method: random boxes of every kind against drawn scenes, with both; and against rays, pixel by pixel.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use mullion_client::gpu::{GpuError, Renderer};
use mullion_client::occlusion::unit::{Counts, Coverage, DepthImage, Footprint};
use mullion_common::geometry::Aabb;
use mullion_common::wall::{Projection, ViewId};

use crate::fixture::{
    Look, NEAR_M, Numbers, Scene, asymmetric_box, clutter, coinciding_sheets, draw, gpu, plain, rectangle, renderer,
};

const VIEW: ViewId = ViewId(4);

/// A box where it stands.
#[derive(Clone, Copy, Debug)]
struct Placed {
    bounds: Aabb,
    world_from_local: DAffine3,
}

impl Placed {
    fn footprint(&self, look: &Look) -> Footprint {
        Footprint::of(&look.projection(), look.size_px, &self.bounds, &self.world_from_local)
    }
}

/// Straight ahead, and three that are not: off the axis, beside the screen, and turned.
fn looks(numbers: &mut Numbers, size_px: [u32; 2]) -> Vec<Look> {
    let eye = numbers.vector(-2.0, 2.0);
    let turn = DQuat::from_scaled_axis(numbers.vector(-2.0, 2.0));
    let through = |turn: DQuat, [left, right, bottom, top]: [f64; 4]| {
        let corner = |x: f64, y: f64| eye + turn * DVec3::new(x, y, -1.0);
        Look { eye, corners: [corner(left, bottom), corner(right, bottom), corner(left, top)], size_px }
    };
    vec![
        Look::ahead(eye, size_px),
        through(DQuat::IDENTITY, [-0.9, 0.2, -0.1, 0.75]),
        through(DQuat::IDENTITY, [0.6, 1.9, 0.3, 1.1]),
        through(turn, [-0.3, 0.5, -0.6, 0.2]),
    ]
}

/// Where a point of the screen, in pixels, is at a distance along the view.
fn at_pixel(look: &Look, pixel: DVec2, distance_m: f64) -> DVec3 {
    look.eye + ray_per_m(&look.projection(), look.size_px, pixel) * distance_m
}

/// The way from the eye to what is seen at a point of the screen, for each metre along the view.
fn ray_per_m(projection: &Projection, size_px: [u32; 2], pixel: DVec2) -> DVec3 {
    let row = |row: usize| projection.clip_from_offset.row(row).truncate();
    let clip_from_offset = DMat3::from_cols(row(0), row(1), row(3)).transpose();
    let [width, height] = size_px.map(f64::from);
    clip_from_offset.inverse() * DVec3::new(2.0 * pixel.x / width - 1.0, 1.0 - 2.0 * pixel.y / height, 1.0)
}

fn metres_per_px(look: &Look) -> f64 {
    look.corners[0].distance(look.corners[1]) / f64::from(look.size_px[0])
}

/// A box around a place, turned.
fn turned(numbers: &mut Numbers, middle: DVec3, half: DVec3) -> Placed {
    let turn = DQuat::from_scaled_axis(numbers.vector(-2.0, 2.0));
    Placed { bounds: Aabb { min: -half, max: half * 0.7 }, world_from_local: DAffine3::from_rotation_translation(turn, middle) }
}

/// Boxes of all kinds, several of each.
fn boxes(numbers: &mut Numbers, look: &Look, of_each: u32) -> Vec<Placed> {
    let size = DVec2::from_array(look.size_px.map(f64::from));
    let mut placed = Vec::new();
    for _ in 0..of_each {
        let pixel = DVec2::new(numbers.between(0.0, size.x), numbers.between(0.0, size.y));
        let distance_m = numbers.between(1.0, 30.0);
        let middle = at_pixel(look, pixel, distance_m);
        let px_m = metres_per_px(look) * distance_m;
        let half = numbers.vector(0.2, 3.0);
        placed.push(turned(numbers, middle, half));
        placed.push(turned(numbers, middle, DVec3::new(0.3, 0.9, 0.5) * px_m)); // about a pixel
        let less = DVec3::new(0.2, 0.1, 0.3) * (px_m * numbers.between(0.0, 1.0));
        placed.push(turned(numbers, middle, less));
        let flat = turned(numbers, middle, half);
        let (mut sheet, mut rod) = (flat.bounds, flat.bounds);
        sheet.max.y = sheet.min.y;
        (rod.max.x, rod.max.z) = (rod.min.x, rod.min.z);
        let point = Aabb { min: flat.bounds.min, max: flat.bounds.min };
        placed.extend([sheet, rod, point].map(|bounds| Placed { bounds, ..flat }));
        let sheared = DMat3::from_cols(numbers.vector(-1.0, 1.0), numbers.vector(-1.0, 1.0), numbers.vector(-1.0, 1.0));
        let world_from_local = DAffine3 { matrix3: sheared, translation: middle };
        placed.push(Placed { bounds: Aabb { min: half * -0.6, max: half }, world_from_local });
        placed.push(mirrored(&turned(numbers, middle, half)));
        let (beside, close) = (look.eye + numbers.vector(-1.0, 1.0), look.eye + numbers.vector(-0.1, 0.1));
        placed.push(turned(numbers, beside, half)); // around the eye or beside it
        placed.push(turned(numbers, close, DVec3::splat(0.02))); // between it and the near plane, or across that
        placed.push(turned(numbers, at_pixel(look, size * 0.5, -distance_m), half)); // behind it
        let edge = at_pixel(look, DVec2::new(pixel.x, if numbers.next().is_multiple_of(2) { 0.0 } else { size.y }), distance_m);
        placed.push(turned(numbers, edge, half));
        placed.push(turned(numbers, at_pixel(look, size * 0.5, 40.0), DVec3::splat(90.0 + distance_m))); // the eye far inside
        placed.push(turned(numbers, at_pixel(look, size * 0.5, 40.0), DVec3::new(55.0, 55.0, 0.5))); // a slab before or around it
    }
    placed
}

fn mirrored(placed: &Placed) -> Placed {
    let mirror = DAffine3::from_scale(DVec3::new(1.0, -1.0, 1.0));
    Placed { world_from_local: placed.world_from_local * mirror, ..*placed }
}

/// How often each kind of box was met.
#[derive(Default)]
struct Kinds(BTreeMap<&'static str, u32>);

impl Kinds {
    fn add(&mut self, look: &Look, placed: &Placed, footprint: &Footprint, counts: &Counts) {
        let projection = look.projection();
        let w = placed.bounds.corners().map(|corner| projection.clip(placed.world_from_local.transform_point3(corner)).w);
        let (is_before, is_beyond) = (w.iter().any(|w| f64::from(*w) < NEAR_M), w.iter().any(|w| f64::from(*w) > NEAR_M));
        let is_cut = |axis: usize| {
            let most = look.size_px[axis] as i32 * 256;
            footprint.corners().iter().any(|corner| corner[axis] < 0 || corner[axis] > most)
        };
        let all = look.size_px[0] * look.size_px[1];
        let flat = placed.bounds.size().to_array().iter().filter(|edge| **edge == 0.0).count();
        let is_fronts = footprint.coverage() == Coverage::Fronts;
        for (kind, is_of_it) in [
            ("all", true),
            ("cut by the near plane", is_before && is_beyond && is_fronts),
            ("cut by the tile's edge", is_cut(0) || is_cut(1)),
            ("behind the eye", w.iter().all(|w| *w < 0.0)),
            ("nothing on the tile", footprint.coverage() == Coverage::Nothing),
            ("eye inside", footprint.coverage() == Coverage::NoFront),
            ("one face", footprint.coverage() == Coverage::Fronts && footprint.fronts()[1].at_anchor == 2.0),
            ("three faces", is_fronts && footprint.fronts()[2].at_anchor != 2.0),
            ("full screen", counts.projected == all),
            ("one pixel", counts.projected == 1),
            ("between pixels", footprint.coverage() != Coverage::Nothing && counts.projected == 0),
            ("flat", flat == 1),
            ("rod or point", flat > 1),
            ("mirrored", placed.world_from_local.matrix3.determinant() < 0.0),
            ("sheared", placed.world_from_local.matrix3.x_axis.dot(placed.world_from_local.matrix3.y_axis).abs() > 1e-6),
            ("hidden", counts.projected > 0 && counts.visible == 0),
            ("partly hidden", counts.visible > 0 && counts.visible < counts.projected),
            ("wholly visible", counts.visible > 0 && counts.visible == counts.projected),
        ] {
            *self.0.entry(kind).or_default() += u32::from(is_of_it);
        }
    }

    fn assert_at_least(&self, least: u32) {
        println!("{:?}", self.0);
        assert!(self.0.values().all(|count| *count >= least), "each kind at least {least} times: {:?}", self.0);
    }
}

/// Boxes of leaves, whose faces tie with what is drawn.
fn leaf_boxes(scene: &Scene) -> Vec<Placed> {
    let transform = |object: usize| scene.manifest.transforms[object].affine();
    let leaves = scene.manifest.leaves.iter();
    leaves.map(|leaf| Placed { bounds: leaf.local_aabb(), world_from_local: transform(leaf.object.0 as usize) }).collect()
}

fn count_on_both(renderer: &mut Renderer, look: &Look, footprints: &[Footprint]) -> Vec<Counts> {
    let depths = renderer.read_depth(VIEW).expect("read");
    let depth = DepthImage::new(look.size_px, &depths).expect("as many as pixels");
    let on_gpu = renderer.count_boxes(VIEW, footprints).expect("counted");
    assert_eq!(on_gpu.len(), footprints.len());
    for (footprint, on_gpu) in footprints.iter().zip(&on_gpu) {
        let on_cpu = footprint.count(&depth);
        assert_eq!(on_cpu, *on_gpu, "{footprint:?}");
        assert_eq!(on_cpu.closest.to_bits(), on_gpu.closest.to_bits(), "{footprint:?}");
    }
    on_gpu
}

#[test]
fn gpu_and_cpu_count_the_same() {
    let Some(gpu) = gpu() else { return };
    let scene = clutter(500);
    let mut numbers = Numbers(62);
    let mut kinds = Kinds::default();
    for (size_px, of_each) in
        [([143, 91], 8), ([650, 650], 3), ([64, 64], 4), ([1, 1], 2), ([517, 2], 2), ([3, 1030], 2), ([8180, 2], 2)]
    {
        let mut renderer = renderer(&gpu, &scene, size_px);
        for look in looks(&mut numbers, size_px) {
            draw(&mut renderer, &scene, &look, &scene.all());
            let mut placed = boxes(&mut numbers, &look, of_each);
            placed.extend(leaf_boxes(&scene).into_iter().step_by(9));
            let footprints: Vec<_> = placed.iter().map(|placed| placed.footprint(&look)).collect();
            let counts = count_on_both(&mut renderer, &look, &footprints);
            for ((placed, footprint), counts) in placed.iter().zip(&footprints).zip(&counts) {
                kinds.add(&look, placed, footprint, counts);
            }
        }
    }
    kinds.assert_at_least(25);
}

#[test]
fn thousands_of_boxes_are_counted_at_once_and_none_at_all() {
    let Some(gpu) = gpu() else { return };
    let scene = clutter(200);
    let mut numbers = Numbers(63);
    let look = looks(&mut numbers, [143, 91])[3];
    let mut renderer = renderer(&gpu, &scene, look.size_px);
    draw(&mut renderer, &scene, &look, &scene.all());
    for of_each in [0, 1, 300, 2] {
        let footprints: Vec<_> = boxes(&mut numbers, &look, of_each).iter().map(|placed| placed.footprint(&look)).collect();
        count_on_both(&mut renderer, &look, &footprints);
    }
    assert_eq!(renderer.count_boxes(ViewId(9), &[]), Err(GpuError::UnknownView(9)));
}

/// Edges through pixels' centres: along rows and columns and diagonally, from every step of a pixel.
#[test]
fn edges_through_centers_are_drawn_by_the_top_left_rule() {
    let Some(gpu) = gpu() else { return };
    let scene = clutter(50);
    let look = Look::ahead(DVec3::ZERO, [64, 64]);
    let mut renderer = renderer(&gpu, &scene, look.size_px);
    draw(&mut renderer, &scene, &look, &scene.all());
    let distance_m = 5.0;
    let square = |turn: DQuat, [x, y]: [u32; 2], half_px: f64| {
        let steps = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
        let half_m = half_px * metres_per_px(&look) * distance_m;
        let middle = at_pixel(&look, DVec2::new(20.0, 40.0) + steps / 256.0, distance_m);
        let bounds = Aabb { min: DVec3::new(-half_m, -half_m, 0.0), max: DVec3::new(half_m, half_m, 0.0) };
        Placed { bounds, world_from_local: DAffine3::from_rotation_translation(turn, middle) }.footprint(&look)
    };
    let diagonally = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4);
    let mut footprints: Vec<_> = (0..256).map(|step| square(DQuat::IDENTITY, [step, step], 6.0)).collect();
    footprints.extend((0..1024).map(|step| square(diagonally, [step % 256, step / 256 * 63], 12.0 / 2.0f64.sqrt())));
    let mut through = BTreeMap::<[i32; 2], u32>::new();
    for corners in footprints.iter().map(Footprint::corners) {
        for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
            let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
            let from_center = [from[0] - 128, from[1] - 128];
            let is_even = dx == 0 || dy == 0 || dx.abs() == dy.abs();
            if is_even && (from_center[0] * dy.signum() - from_center[1] * dx.signum()) % 256 == 0 {
                *through.entry([dx.signum(), dy.signum()]).or_default() += 1;
            }
        }
    }
    println!("{through:?}");
    assert_eq!(through.len(), 8, "edges of every direction run through centres: {through:?}");
    count_on_both(&mut renderer, &look, &footprints);
}

/// A box as near as what is drawn is visible, and one that is farther by the last bit is hidden.
#[test]
fn a_tie_is_visible() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let wall = scene.mesh(&rectangle([-20.0, -20.0], [20.0, 20.0]));
    let paint = scene.material(plain([0.7, 0.6, 0.5, 1.0]));
    let object = scene.object(DAffine3::from_translation(DVec3::new(0.0, 0.0, -5.0)));
    scene.leaf(object, wall, paint);
    let look = Look::ahead(DVec3::ZERO, [64, 40]);
    let mut renderer = renderer(&gpu, &scene, look.size_px);
    draw(&mut renderer, &scene, &look, &scene.all());
    let drawn = renderer.read_depth(VIEW).expect("read")[64 * 20 + 32];
    let at_distance = |distance_m: f64| {
        let bounds = Aabb { min: DVec3::new(-0.5, -0.4, -1.0 - distance_m), max: DVec3::new(0.3, 0.4, -distance_m) };
        Placed { bounds, world_from_local: DAffine3::IDENTITY }.footprint(&look)
    };
    // The last distance at which it is not behind.
    let (mut near, mut far) = (4.0, 6.0);
    for _ in 0..60 {
        let middle = (near + far) / 2.0;
        *(if at_distance(middle).depth_at([32, 20]) >= drawn { &mut near } else { &mut far }) = middle;
    }
    let footprints = [at_distance(near), at_distance(far)];
    let depths = footprints.each_ref().map(|footprint| footprint.depth_at([32, 20]));
    assert_eq!(depths.map(f32::to_bits), [drawn.to_bits(), drawn.to_bits() - 1]);
    let counts = count_on_both(&mut renderer, &look, &footprints);
    assert!(counts[0].projected > 20 && counts[0].visible == counts[0].projected, "{counts:?}");
    assert_eq!((counts[1].projected, counts[1].visible), (counts[0].projected, 0));
}

/// Where a ray through a point of the screen is in a box, in metres along the view; empty where it is not, beyond the near plane.
fn inside_m(placed: &Placed, look: &Look, pixel: DVec2) -> Range<f64> {
    let local_from_world = placed.world_from_local.inverse();
    let origin = local_from_world.transform_point3(look.eye);
    let along = local_from_world.transform_vector3(ray_per_m(&look.projection(), look.size_px, pixel));
    let (at_min, at_max) = ((placed.bounds.min - origin) / along, (placed.bounds.max - origin) / along);
    at_min.min(at_max).max_element().max(NEAR_M)..at_min.max(at_max).min_element()
}

/// All corners of a box beyond the near plane, on the screen.
fn points_px(placed: &Placed, look: &Look) -> Vec<DVec2> {
    let projection = look.projection();
    let corners = placed.bounds.corners().map(|corner| {
        let offset = placed.world_from_local.transform_point3(corner) - look.eye;
        projection.clip_from_offset * offset.extend(1.0)
    });
    let mut points: Vec<_> = corners.iter().filter(|clip| clip.w >= NEAR_M).copied().collect();
    for (i, a) in corners.iter().enumerate() {
        for b in corners[i + 1..].iter().filter(|b| (a.w < NEAR_M) != (b.w < NEAR_M)) {
            points.push(a.lerp(*b, (NEAR_M - a.w) / (b.w - a.w)));
        }
    }
    let size = DVec2::from_array(look.size_px.map(f64::from));
    points.iter().map(|clip| DVec2::new(0.5 + 0.5 * clip.x / clip.w, 0.5 - 0.5 * clip.y / clip.w) * size).collect()
}

/// From a point to a segment, the larger of right and down: least where it changes its direction.
fn distance_px(point: DVec2, a: DVec2, b: DVec2) -> f64 {
    let (from, along) = (a - point, b - a);
    let at = [
        0.0,
        1.0,
        -from.x / along.x,
        -from.y / along.y,
        (from.y - from.x) / (along.x - along.y),
        -(from.x + from.y) / (along.x + along.y),
    ];
    let distances = at.into_iter().filter(|t| t.is_finite()).map(|t| (from + along * t.clamp(0.0, 1.0)).abs().max_element());
    distances.fold(f64::INFINITY, f64::min)
}

/// From a point outside a box's silhouette to it: the silhouette is made of some of the lines between all points.
fn distance_to_silhouette_px(points: &[DVec2], point: DVec2) -> f64 {
    let pairs = points.iter().enumerate().flat_map(|(i, a)| points[i..].iter().map(move |b| (*a, *b)));
    pairs.map(|(a, b)| distance_px(point, a, b)).fold(f64::INFINITY, f64::min)
}

/// How pixels of footprints compare with rays.
#[derive(Debug, Default)]
struct Compared {
    same: u32,
    grown: u32,
    /// Pixels whose depth is within 1/1000 of the ray's.
    close: u32,
}

fn compare(placed: &Placed, look: &Look, compared: &mut Compared) -> Counts {
    let footprint = placed.footprint(look);
    let silhouette = points_px(placed, look);
    let steepest = footprint.fronts().iter().map(|front| front.right.abs() + front.down.abs()).fold(0.0, f32::max);
    for y in 0..look.size_px[1] {
        let span = if footprint.rows().contains(&y) { footprint.span(y) } else { 0..0 };
        for x in 0..look.size_px[0] {
            let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let inside_m = inside_m(placed, look, center);
            let is_covered = inside_m.end >= inside_m.start; // as far in a flat box
            if is_covered != span.contains(&x) {
                let away_px = distance_to_silhouette_px(&silhouette, center);
                assert!(!is_covered, "{x} {y} is missing of {placed:?}");
                assert!(away_px <= 1.0 / 128.0 + 1e-9, "{x} {y} is {away_px} px outside of {placed:?}");
                compared.grown += 1;
            } else if is_covered {
                let (depth, of_ray) = (f64::from(footprint.depth_at([x, y])), NEAR_M / inside_m.start);
                assert!(depth >= of_ray, "{x} {y}: {depth} is behind {of_ray} of {placed:?}");
                let most = of_ray + f64::from(steepest) / 100.0 + f64::from(footprint.nearest()) / 60.0;
                let is_fronts = footprint.coverage() == Coverage::Fronts;
                assert!(!is_fronts || depth <= most, "{x} {y}: {depth} is before {of_ray} of {placed:?}");
                compared.same += 1;
                compared.close += u32::from(depth <= of_ray * 1.001);
            }
        }
    }
    let nothing = vec![0.0; look.size_px.iter().product::<u32>() as usize];
    footprint.count(&DepthImage::new(look.size_px, &nothing).expect("as many as pixels"))
}

#[test]
fn footprints_are_what_rays_meet() {
    let mut numbers = Numbers(64);
    let mut compared = Compared::default();
    let mut kinds = Kinds::default();
    for (size_px, of_each) in [([143, 91], 4), ([37, 60], 8), ([650, 650], 1)] {
        for look in looks(&mut numbers, size_px) {
            for placed in boxes(&mut numbers, &look, of_each) {
                let counts = compare(&placed, &look, &mut compared);
                kinds.add(&look, &placed, &placed.footprint(&look), &counts);
            }
        }
    }
    println!("{compared:?}");
    for never in ["hidden", "partly hidden"] {
        assert_eq!(kinds.0.remove(never), Some(0), "before nothing all is visible");
    }
    kinds.assert_at_least(20);
    assert!(compared.same > 1_000_000 && compared.grown > 100, "{compared:?}");
    assert!(compared.close > compared.same / 10 * 9, "{compared:?}");
}

#[test]
fn where_a_leaf_is_seen_its_box_is_visible() {
    let Some(gpu) = gpu() else { return };
    let mut scene = clutter(400);
    scene.join(&coinciding_sheets(60));
    // Boxes along the axes, whose faces are those of their bounds.
    let mesh = scene.mesh(&asymmetric_box());
    let paint = scene.material(plain([0.5, 0.6, 0.7, 1.0]));
    let mut numbers = Numbers(65);
    for _ in 0..150 {
        let object = scene.object(DAffine3::from_translation(numbers.vector(-9.0, 9.0)));
        scene.leaf(object, mesh, paint);
    }
    let (mut leaves, mut pixels, mut of_sheets) = (0, 0, 0);
    for (size_px, rounds) in [([143, 91], 40), ([650, 650], 4)] {
        let mut renderer = renderer(&gpu, &scene, size_px);
        for look in (0..rounds).flat_map(|_| looks(&mut numbers, size_px)) {
            draw(&mut renderer, &scene, &look, &scene.all());
            let footprints: Vec<_> = leaf_boxes(&scene).iter().map(|placed| placed.footprint(&look)).collect();
            let counts = renderer.count_boxes(VIEW, &footprints).expect("counted");
            let seen = renderer.read_leaves(VIEW).expect("read");
            let depths = renderer.read_depth(VIEW).expect("read");
            let mut of_leaf = vec![(0u32, 0.0f32); counts.len()];
            for (at, leaf) in seen.iter().enumerate().filter(|(_, leaf)| **leaf > 0) {
                let leaf = *leaf as usize - 1;
                let [x, y] = [at as u32 % size_px[0], at as u32 / size_px[0]];
                of_leaf[leaf] = (of_leaf[leaf].0 + 1, of_leaf[leaf].1.max(depths[at]));
                assert!(footprints[leaf].span(y).contains(&x), "leaf {leaf} at {x} {y}: {:?}", footprints[leaf]);
                let depth = footprints[leaf].depth_at([x, y]);
                assert!(depth >= depths[at], "leaf {leaf} at {x} {y}: {depth} is behind {}, {:?}", depths[at], footprints[leaf]);
            }
            for (leaf, ((seen, nearest), counts)) in of_leaf.into_iter().zip(&counts).enumerate() {
                assert!(
                    counts.visible >= seen && (seen == 0 || counts.closest >= nearest),
                    "leaf {leaf}: {counts:?}, seen {seen} {nearest}"
                );
                leaves += u32::from(seen > 0);
                of_sheets += u32::from(seen > 0 && footprints[leaf].coverage() == Coverage::Fronts && (400..520).contains(&leaf));
                pixels += seen;
            }
        }
    }
    println!("{leaves} leaves seen in {pixels} pixels, {of_sheets} of them sheets");
    assert!(leaves > 1500 && of_sheets > 200 && pixels > 1_000_000, "{leaves} leaves, {of_sheets} sheets, {pixels} pixels");
}
