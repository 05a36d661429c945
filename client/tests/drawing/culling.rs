//! Culling changes no pixel, and tiles make one picture.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use mullion_client::gpu::Gpu;
use mullion_common::scene::{GeometryChunk, Material};
use mullion_common::visible_set::VisibleSet;

use crate::fixture::{Look, Numbers, Picture, Scene, clutter, coinciding_sheets, draw, gpu, pattern, plain, rectangle, renderer};

/// A far off-axis look somewhere among the boxes.
fn random_look(numbers: &mut Numbers) -> Look {
    let eye = numbers.vector(-9.0, 9.0);
    let turn = DQuat::from_scaled_axis(numbers.vector(-2.5, 2.5));
    let (left, bottom) = (numbers.between(-3.0, 0.9), numbers.between(-2.0, 0.9));
    let corner = |x: f64, y: f64| eye + turn * DVec3::new(x, y, -1.0);
    let corners = [corner(left, bottom), corner(left + 1.1, bottom), corner(left, bottom + 0.7)];
    Look { eye, corners, size_px: [143, 91] }
}

#[test]
fn a_tile_of_its_visible_set_is_the_tile_of_all_leaves() {
    let Some(gpu) = gpu() else { return };
    let scene = clutter(600);
    let mut renderer = renderer(&gpu, &scene, [143, 91]);
    let mut numbers = Numbers(1);
    let (mut culled, mut drawn) = (0, 0);
    for _ in 0..12 {
        let look = random_look(&mut numbers);
        let visible = scene.visible(&look.frustum());
        let all = draw(&mut renderer, &scene, &look, &scene.all());
        let some = draw(&mut renderer, &scene, &look, &visible);
        assert!(all.color == some.color && all.ids == some.ids, "eye {}: pictures differ", look.eye);
        culled += scene.all().len() - visible.len();
        drawn += some.ids.iter().filter(|&&id| id != 0).count();
        // Of nothing, nothing.
        let none = draw(&mut renderer, &scene, &look, &VisibleSet::default());
        assert!(none.ids.iter().all(|&id| id == 0) && none.color.pixels().all(|p| p == none.color.get_pixel(0, 0)));
    }
    assert!(culled > 3000 && drawn > 12 * 1000, "the views must show something and cull something: {culled}, {drawn}");
}

/// Sheets behind z = -5, seen edge-on from the origin but for an angle of 1e-8 to 1e-3.
fn sheets_edge_on(count: u16) -> GeometryChunk {
    let mut numbers = Numbers(9);
    let mut chunk = GeometryChunk::default();
    for sheet in 0..count {
        let (tangent, below) = (numbers.between(-1.0, 1.0), numbers.between(-0.6, 0.5));
        let off = 10_f64.powf(numbers.between(-8.0, -3.0));
        for (distance, tangent, height) in
            [(5.01, tangent, 0.0), (9.0, tangent + off, 0.0), (9.0, tangent + off, 0.1), (5.01, tangent, 0.1)]
        {
            let place = DVec3::new(tangent, below + height, -1.0) * distance;
            chunk.positions.push(place.as_vec3().to_array());
            chunk.vertex_ids.push(chunk.positions.len() as u32);
        }
        chunk.indices.extend([0, 1, 2, 0, 2, 3].map(|corner| 4 * sheet + corner));
    }
    chunk
}

#[test]
fn what_is_seen_edge_on_stays_behind_what_is_before_it() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::default();
    let material = scene.material(Material { double_sided: true, ..plain([1.0; 4]) });
    let object = scene.object(DAffine3::IDENTITY);
    let mesh = scene.mesh(&sheets_edge_on(8000));
    let sheets = scene.leaf(object, mesh, material);
    let (wall, mesh) = (DAffine3::from_translation(DVec3::new(0.0, 0.0, -5.0)), scene.mesh(&rectangle([-9.0, -9.0], [9.0, 9.0])));
    let wall = scene.object(wall);
    scene.leaf(wall, mesh, material);
    let look = Look::ahead(DVec3::ZERO, [286, 182]);
    let mut renderer = renderer(&gpu, &scene, look.size_px);
    let pixels = |picture: Picture| picture.ids.iter().filter(|id| **id == sheets + 1).count();
    let alone = pixels(draw(&mut renderer, &scene, &look, &VisibleSet::all(1)));
    assert!(alone > 1000, "{alone} pixels of sheets");
    assert_eq!(pixels(draw(&mut renderer, &scene, &look, &scene.all())), 0);
}

/// A textured ground that reaches kilometres in all directions, in two triangles that pass through the near plane.
fn add_ground(scene: &mut Scene) {
    let mut ground = rectangle([-3000.0, -2000.0], [2000.0, 4000.0]);
    ground.uvs.iter_mut().flatten().for_each(|v| *v *= 300.0);
    let texture = Some(scene.texture(pattern(128)));
    let material = scene.material(Material { texture, double_sided: true, ..plain([1.0; 4]) });
    let lie_down = DAffine3::from_rotation_translation(DQuat::from_rotation_x(-1.6), DVec3::new(0.0, -3.0, 0.0));
    let (object, mesh) = (scene.object(lie_down), scene.mesh(&ground));
    scene.leaf(object, mesh, material);
}

#[test]
fn tiles_make_the_picture_of_the_whole_screen() {
    let Some(gpu) = gpu() else { return };
    let mut scene = clutter(600);
    add_ground(&mut scene);
    for (grid, tile_px) in [([2, 2], [128, 96]), ([3, 2], [85, 97])] {
        assert_seamless(&gpu, &scene, grid, tile_px, 1);
    }
}

#[test]
fn tiles_agree_on_faces_that_coincide() {
    let Some(gpu) = gpu() else { return };
    for (grid, tile_px) in [([2, 2], [128, 96]), ([4, 3], [61, 53])] {
        // All that is seen coincides. Without rounded depth 70 in a thousand pixels differ; each bit halves them.
        assert_seamless(&gpu, &coinciding_sheets(60), grid, tile_px, 4);
    }
}

/// From several random looks, at most so many in a thousand of the wall's pixels differ by more than 2/255 from one picture.
fn assert_seamless(gpu: &Arc<Gpu>, scene: &Scene, grid: [u32; 2], tile_px: [u32; 2], most_per_mille: u32) {
    const LOOKS: u32 = 4;
    let mut numbers = Numbers(2);
    let size_px = [grid[0] * tile_px[0], grid[1] * tile_px[1]];
    let (mut whole, mut tiled) = (renderer(gpu, scene, size_px), renderer(gpu, scene, tile_px));
    let (mut differing, mut worst_inside) = (0, 0);
    for _ in 0..LOOKS {
        let look = Look { size_px, ..random_look(&mut numbers) };
        let screen = draw(&mut whole, scene, &look, &scene.all());
        for (i, tile) in look.tiles(grid).iter().enumerate() {
            let [column, row] = [i as u32 % grid[0], i as u32 / grid[0]];
            let picture = draw(&mut tiled, scene, tile, &scene.visible(&tile.frustum()));
            for (x, y, pixel) in picture.color.enumerate_pixels() {
                let [at_x, at_y] = [column * tile_px[0] + x, row * tile_px[1] + y];
                let other = screen.color.get_pixel(at_x, at_y);
                let difference = pixel.0.iter().zip(other.0).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0);
                differing += u32::from(difference > 2);
                if picture.id(x, y) == screen.id(at_x, at_y) && difference > 2 {
                    worst_inside = worst_inside.max(difference);
                }
            }
        }
    }
    let pixels = size_px[0] * size_px[1] * LOOKS;
    println!("{grid:?}: {differing} of {pixels} pixels differ by more than 2, by {worst_inside} within an object");
    assert!(differing * 1000 <= pixels * most_per_mille, "{grid:?}: {differing} of {pixels} pixels differ by more than 2");
}
