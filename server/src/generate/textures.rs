//! Small pictures drawn by rule: facades, asphalt, paving, leaves. All repeat without a seam.
use super::random::Random;
use image::{ImageEncoder, Rgba, RgbaImage};

/// How a facade's windows are laid out.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Facade {
    /// Single windows in plaster.
    Plaster,
    /// Single windows in brick.
    Brick,
    /// Bands of glass.
    Office,
}

/// Bays and storeys to one repeat of a facade texture.
pub const FACADE_BAYS: f32 = 4.0;
const BAY_PX: u32 = 64;

pub fn facade(kind: Facade, random: &mut Random) -> Vec<u8> {
    let bays = FACADE_BAYS as u32;
    let mut picture = RgbaImage::from_fn(bays * BAY_PX, bays * BAY_PX, |x, y| {
        let mortar = match kind {
            Facade::Brick => y % 8 == 0 || (x + if (y / 8) % 2 == 0 { 0 } else { 8 }) % 16 == 0,
            Facade::Office => false,
            Facade::Plaster => y % BAY_PX >= BAY_PX - 3,
        };
        let base = if mortar { 190.0 } else { 232.0 };
        grey(base + random.range(-9.0, 9.0))
    });
    for bay in 0..bays * bays {
        window(&mut picture, kind, (bay % bays) * BAY_PX, (bay / bays) * BAY_PX, random);
    }
    png(&picture)
}

fn window(picture: &mut RgbaImage, kind: Facade, x0: u32, y0: u32, random: &mut Random) {
    let (left, right, top, bottom): (u32, u32, u32, u32) = match kind {
        Facade::Office => (2, 62, 12, 52),
        Facade::Brick => (18, 46, 10, 50),
        Facade::Plaster => (15, 49, 12, 50),
    };
    let lit = random.chance(0.16);
    let curtain = if random.chance(0.4) { random.below(14) as u32 + 4 } else { 0 };
    let shade = random.range(0.75, 1.25);
    for y in top..bottom {
        for x in left..right {
            let frame = x < left + 3 || x >= right - 3 || y < top + 3 || y >= bottom - 3 || x.abs_diff(32) < 1;
            let depth = (y - top) as f32 / (bottom - top) as f32;
            let color = if frame {
                Rgba([244, 240, 230, 255])
            } else if y < top + curtain {
                Rgba([222, 205, 178, 255])
            } else if lit {
                Rgba([250, (205.0 + 20.0 * depth) as u8, 130, 255])
            } else {
                // Sky above, street below, as glass reflects them.
                rgb(shade * (92.0 - 44.0 * depth), shade * (122.0 - 52.0 * depth), shade * (150.0 - 58.0 * depth))
            };
            picture.put_pixel(x0 + x, y0 + y, color);
        }
    }
    if kind != Facade::Office {
        for x in left - 3..right + 3 {
            for y in bottom..bottom + 4 {
                picture.put_pixel(x0 + x, y0 + y, Rgba([176, 170, 160, 255]));
            }
        }
    }
}

pub fn asphalt(random: &mut Random) -> Vec<u8> {
    png(&RgbaImage::from_fn(128, 128, |_, _| {
        let stone = if random.chance(0.06) { 26.0 } else { 0.0 };
        grey(84.0 + stone + random.range(-10.0, 10.0))
    }))
}

pub fn paving(random: &mut Random) -> Vec<u8> {
    let tints: Vec<f32> = (0..16).map(|_| random.range(-14.0, 14.0)).collect();
    png(&RgbaImage::from_fn(128, 128, |x, y| {
        let joint = x % 32 < 2 || y % 32 < 2;
        let base = if joint { 138.0 } else { 182.0 + tints[(y / 32 * 4 + x / 32) as usize] };
        let value = base + random.range(-6.0, 6.0);
        rgb(value, value * 0.975, value * 0.93)
    }))
}

pub fn grass(random: &mut Random) -> Vec<u8> {
    png(&RgbaImage::from_fn(128, 128, |_, _| {
        let value = random.range(0.8, 1.2);
        rgb(96.0 * value, 128.0 * value, 70.0 * value)
    }))
}

/// Leaves on nothing: alpha is 0 or 255.
pub fn leaves(random: &mut Random) -> Vec<u8> {
    const SIDE: i32 = 128;
    let mut picture = RgbaImage::from_pixel(SIDE as u32, SIDE as u32, Rgba([70, 105, 48, 0]));
    for _ in 0..230 {
        let (cx, cy) = (random.below(SIDE as usize) as i32, random.below(SIDE as usize) as i32);
        // Fewer towards the corners, so that a card does not look like a card.
        let (dx, dy) = (cx - SIDE / 2, cy - SIDE / 2);
        if dx * dx + dy * dy > 56 * 56 {
            continue;
        }
        let tone = random.range(0.75, 1.35);
        let color = rgb(74.0 * tone, 118.0 * tone, 46.0 * tone);
        let (long, wide) = if random.chance(0.5) { (7, 4) } else { (4, 7) };
        for y in -wide..=wide {
            for x in -long..=long {
                let inside = x * x * wide * wide + y * y * long * long <= long * long * wide * wide;
                let (px, py) = (cx + x, cy + y);
                if inside && (0..SIDE).contains(&px) && (0..SIDE).contains(&py) {
                    picture.put_pixel(px as u32, py as u32, color);
                }
            }
        }
    }
    png(&picture)
}

fn grey(value: f32) -> Rgba<u8> {
    rgb(value, value, value)
}

fn rgb(r: f32, g: f32, b: f32) -> Rgba<u8> {
    Rgba([r as u8, g as u8, b as u8, 255])
}

fn png(picture: &RgbaImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    let (width, height) = picture.dimensions();
    encoder
        .write_image(picture.as_raw(), width, height, image::ExtendedColorType::Rgba8)
        // Writing to a vector cannot fail, and the buffer has the size of the picture.
        .expect("a small picture encodes into memory");
    bytes
}
