//! Lines and translucent polygons on a picture.

use glam::DVec2;
use image::{Rgba, RgbaImage};

/// A picture that is drawn on.
pub struct Canvas(RgbaImage);

/// How many polygons cover each pixel, so that a crowd of them stays translucent. Drawn at once.
pub struct Veil {
    width: u32,
    /// Row-major.
    layers: Vec<u16>,
}

impl Veil {
    /// One that covers nothing.
    pub fn new([width, height]: [u32; 2]) -> Self {
        Self { width, layers: vec![0; width as usize * height as usize] }
    }

    /// Covers a convex polygon: pixels whose middle is inside.
    pub fn cover(&mut self, polygon: &[DVec2]) {
        let height = (self.layers.len() / self.width.max(1) as usize) as f64;
        let least = polygon.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        let most = polygon.iter().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
        for row in pixels(least, most, height) {
            let Some([left, right]) = across(polygon, row as f64 + 0.5) else { continue };
            for column in pixels(left, right, f64::from(self.width)) {
                let layers = &mut self.layers[row * self.width as usize + column];
                *layers = layers.saturating_add(1);
            }
        }
    }
}

/// Pixels of a row or column whose middle is between two places.
fn pixels(from: f64, to: f64, count: f64) -> std::ops::Range<usize> {
    let first = |place: f64| (place - 0.5).ceil().clamp(0.0, count) as usize;
    first(from)..first(to)
}

/// Where a convex polygon begins and ends at a height.
fn across(polygon: &[DVec2], y: f64) -> Option<[f64; 2]> {
    let mut ends: Option<[f64; 2]> = None;
    for (k, &from) in polygon.iter().enumerate() {
        let to = polygon[(k + 1) % polygon.len()];
        if (from.y <= y) != (to.y <= y) {
            let x = from.x + (to.x - from.x) * (y - from.y) / (to.y - from.y);
            ends = Some(ends.map_or([x, x], |[least, most]| [least.min(x), most.max(x)]));
        }
    }
    ends
}

/// The convex polygon around some points, in order, without points on its sides.
pub fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(point - b) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop(); // the other half begins with it
        chain
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

impl Canvas {
    /// Draws on this.
    pub fn new(picture: RgbaImage) -> Self {
        Self(picture)
    }

    /// What was drawn.
    pub fn into_picture(self) -> RgbaImage {
        self.0
    }

    /// Lays a veil over the picture, so opaque where it has one layer, and at most where it has many.
    pub fn draw_veil(&mut self, veil: &Veil, color: Rgba<u8>, [one, most]: [f64; 2]) {
        for (pixel, layers) in self.0.pixels_mut().zip(&veil.layers) {
            let open = (1.0 - one).powi(i32::from(*layers).min(64));
            mix(pixel, color, (1.0 - open).min(most));
        }
    }

    /// Draws a polygon's sides.
    pub fn outline(&mut self, polygon: &[DVec2], paint: (Rgba<u8>, f64), width_px: f64) {
        (0..polygon.len()).for_each(|k| self.line([polygon[k], polygon[(k + 1) % polygon.len()]], paint, width_px));
    }

    /// Draws a line with smooth edges, in a colour of some opacity.
    pub fn line(&mut self, ends: [DVec2; 2], (color, opacity): (Rgba<u8>, f64), width_px: f64) {
        // Along x where it is rather level, else along y: in each column the same number of pixels.
        let is_level = (ends[1].x - ends[0].x).abs() >= (ends[1].y - ends[0].y).abs();
        let [mut from, mut to] = if is_level { ends } else { ends.map(|end| DVec2::new(end.y, end.x)) };
        if from.x > to.x {
            (from, to) = (to, from);
        }
        let (width, height) = self.0.dimensions();
        let (columns, rows) = if is_level { (width, height) } else { (height, width) };
        let slope = if to.x > from.x { (to.y - from.y) / (to.x - from.x) } else { 0.0 };
        let half = width_px / 2.0 * (1.0 + slope * slope).sqrt();
        for column in pixels(from.x, to.x, f64::from(columns)) {
            let y = from.y + slope * (column as f64 + 0.5 - from.x);
            for row in pixels(y - half - 0.5, y + half + 0.5, f64::from(rows)) {
                let covered = (half + 0.5 - (row as f64 + 0.5 - y).abs()).clamp(0.0, 1.0);
                let (x, y) = if is_level { (column, row) } else { (row, column) };
                mix(self.0.get_pixel_mut(x as u32, y as u32), color, covered * opacity);
            }
        }
    }

    /// Draws a filled circle.
    pub fn disc(&mut self, middle: DVec2, color: Rgba<u8>, radius_px: f64) {
        let (width, height) = self.0.dimensions();
        for y in pixels(middle.y - radius_px - 1.0, middle.y + radius_px + 1.0, f64::from(height)) {
            for x in pixels(middle.x - radius_px - 1.0, middle.x + radius_px + 1.0, f64::from(width)) {
                let distance = middle.distance(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                mix(self.0.get_pixel_mut(x as u32, y as u32), color, (radius_px + 0.5 - distance).clamp(0.0, 1.0));
            }
        }
    }
}

/// So much of a colour over a pixel.
fn mix(pixel: &mut Rgba<u8>, color: Rgba<u8>, share: f64) {
    for (below, above) in pixel.0.iter_mut().zip(color.0) {
        *below = (f64::from(*below) + (f64::from(above) - f64::from(*below)) * share).round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLACK: Rgba<u8> = Rgba([0, 0, 0, 255]);
    const WHITE: Rgba<u8> = Rgba([255, 255, 255, 255]);

    fn points(points: &[[f64; 2]]) -> Vec<DVec2> {
        points.iter().copied().map(DVec2::from).collect()
    }

    #[test]
    fn a_hull_goes_round_and_leaves_out_what_is_inside() {
        let corners = points(&[[0.0, 0.0], [7.0, 1.0], [8.0, 5.0], [1.0, 4.0]]);
        let mut with_more = points(&[[3.0, 2.0], [7.0, 1.0], [3.5, 0.5]]);
        with_more.extend(&corners);
        assert_eq!(hull(with_more), corners);
        assert_eq!(hull(points(&[[1.0, 1.0], [1.0, 1.0]])), points(&[[1.0, 1.0]]));
        assert_eq!(hull(points(&[[0.0, 0.0], [2.0, 2.0], [1.0, 1.0]])), points(&[[0.0, 0.0], [2.0, 2.0]]));
    }

    #[test]
    fn a_polygon_covers_the_pixels_whose_middle_is_inside() {
        let polygon = hull(points(&[[1.2, 0.3], [6.9, 2.2], [4.1, 8.0], [-3.0, 5.0]]));
        let size = [9, 7];
        let mut veil = Veil::new(size);
        veil.cover(&polygon);
        veil.cover(&polygon);
        for (at, layers) in veil.layers.iter().enumerate() {
            let middle = DVec2::new(at as f64 % 9.0, (at / 9) as f64) + 0.5;
            let side = |k: usize| (polygon[(k + 1) % 4] - polygon[k]).perp_dot(middle - polygon[k]);
            let is_inside = (0..4).all(|k| side(k) > 0.0);
            assert_eq!(*layers, 2 * u16::from(is_inside), "{middle}");
        }
        let mut canvas = Canvas::new(RgbaImage::from_pixel(9, 7, BLACK));
        canvas.draw_veil(&veil, WHITE, [0.5, 0.6]);
        let picture = canvas.into_picture();
        assert_eq!((picture.get_pixel(2, 3)[0], picture.get_pixel(8, 0)[0]), (153, 0));
    }

    #[test]
    fn lines_are_as_wide_as_said_and_end_at_the_border() {
        let mut canvas = Canvas::new(RgbaImage::from_pixel(20, 20, BLACK));
        canvas.line([DVec2::new(-1e6, 10.0), DVec2::new(1e6, 10.0)], (WHITE, 1.0), 2.0);
        canvas.line([DVec2::new(5.0, 1e9), DVec2::new(5.0, -50.0)], (WHITE, 0.5), 2.0);
        canvas.disc(DVec2::new(-3.0, 40.0), WHITE, 9.0);
        let picture = canvas.into_picture();
        let lit = |x: u32| (0..20).filter(|y| picture.get_pixel(x, *y)[0] > 200).collect::<Vec<_>>();
        assert_eq!((lit(0), lit(19)), (vec![9, 10], vec![9, 10]));
        assert_eq!(picture.get_pixel(4, 2)[0], 128);
        assert_eq!(picture.get_pixel(7, 2)[0], 0);
    }
}
