//! Maps of many points as small PNG images in data URIs.

use super::axis;
use crate::geometry::Vec3;
use base64::Engine as _;

/// Number of colours in a scale.
const LEVELS: usize = 41;
/// Index of a pixel without points: the transparent colour after the scale.
const EMPTY: u8 = LEVELS as u8;

/// The colour of `t` in [−1, 1]: blue below, grey at zero, red above; clamped beyond.
pub fn diverging(t: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 7] = [
        [26.0, 66.0, 150.0],
        [52.0, 124.0, 200.0],
        [134.0, 186.0, 222.0],
        [214.0, 213.0, 205.0],
        [240.0, 164.0, 116.0],
        [214.0, 88.0, 68.0],
        [160.0, 20.0, 46.0],
    ];
    let at = if t.is_nan() { 0.0 } else { t.clamp(-1.0, 1.0) };
    between(&STOPS, 0.5 * (at + 1.0))
}

/// [`diverging`] as a CSS colour.
pub fn diverging_css(t: f64) -> String {
    let [r, g, b] = diverging(t);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// The colour of a share from 0 to 1, dark blue to yellow: lighter means more, also for colour-blind readers (cividis).
pub fn grade(share: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 5] = [
        [0.0, 34.0, 78.0],
        [66.0, 78.0, 108.0],
        [124.0, 123.0, 120.0],
        [188.0, 174.0, 108.0],
        [254.0, 232.0, 56.0],
    ];
    between(&STOPS, share)
}

/// [`grade`] as a CSS colour.
pub fn grade_css(share: f64) -> String {
    let [r, g, b] = grade(share);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// The colour at a share of the way along `stops`.
fn between(stops: &[[f64; 3]], share: f64) -> [u8; 3] {
    let place = share.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
    let i = (place.floor() as usize).min(stops.len() - 2);
    let f = place - i as f64;
    std::array::from_fn(|c| (stops[i][c] * (1.0 - f) + stops[i + 1][c] * f).round() as u8)
}

/// A rectangle of the ground, east and north, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// South-west corner.
    pub min: [f64; 2],
    /// North-east corner.
    pub max: [f64; 2],
}

impl Bounds {
    /// The smallest rectangle around the finite `points`; `None` without any.
    pub fn around(points: impl Iterator<Item = [f64; 2]> + Clone) -> Option<Self> {
        let finite = points.filter(|p| p[0].is_finite() && p[1].is_finite());
        let (x0, x1) = axis::range(finite.clone().map(|p| p[0]))?;
        let (y0, y1) = axis::range(finite.map(|p| p[1]))?;
        // A single point or a line gets a small area.
        let spare = 1e-3f64.max(1e-3 * (x1 - x0).max(y1 - y0));
        Some(Self {
            min: [x0 - spare, y0 - spare],
            max: [x1 + spare, y1 + spare],
        })
    }

    fn size(&self) -> [f64; 2] {
        [self.max[0] - self.min[0], self.max[1] - self.min[1]]
    }
}

/// A grid of pixels over `bounds`.
struct Grid {
    bounds: Bounds,
    width: usize,
    height: usize,
    pixel_m: f64,
}

impl Grid {
    /// A grid of at most `most` pixels in either direction.
    fn new(bounds: Bounds, most: usize) -> Self {
        let [dx, dy] = bounds.size();
        let pixel_m = dx.max(dy) / most as f64;
        let pixels = |length: f64| ((length / pixel_m).ceil() as usize).clamp(1, most);
        Self {
            bounds,
            width: pixels(dx),
            height: pixels(dy),
            pixel_m,
        }
    }

    /// Column and row (from the north) of a point; `None` outside.
    fn pixel(&self, p: [f64; 2]) -> Option<(usize, usize)> {
        let column = (p[0] - self.bounds.min[0]) / self.pixel_m;
        let row = (self.bounds.max[1] - p[1]) / self.pixel_m;
        let inside = column >= 0.0 && row >= 0.0;
        let (column, row) = (column as usize, row as usize);
        (inside && column < self.width && row < self.height).then_some((column, row))
    }

    /// Half the edge of the square painted for a point, in pixels, such that neighbours touch:
    /// from the area and number of the points.
    fn reach(&self, points: impl Iterator<Item = [f64; 2]> + Clone) -> usize {
        let coarse = Self::new(self.bounds, 40);
        let mut seen = vec![false; coarse.width * coarse.height];
        let mut n = 0usize;
        for (column, row) in points.filter_map(|p| coarse.pixel(p)) {
            seen[row * coarse.width + column] = true;
            n += 1;
        }
        let covered = seen.iter().filter(|s| **s).count() as f64 * coarse.pixel_m.powi(2);
        let spacing = (covered / n.max(1) as f64).sqrt();
        // Irregular points need slightly more than half their mean spacing.
        ((0.6 * spacing / self.pixel_m).round() as usize).min(6)
    }

    /// Extent of the image on the ground: whole pixels, aligned to the north-west corner.
    fn extent(&self) -> Bounds {
        Bounds {
            min: [
                self.bounds.min[0],
                self.bounds.max[1] - self.height as f64 * self.pixel_m,
            ],
            max: [
                self.bounds.min[0] + self.width as f64 * self.pixel_m,
                self.bounds.max[1],
            ],
        }
    }
}

/// An image and its extent on the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Data URI of a PNG.
    pub uri: String,
    /// Its corners.
    pub extent: Bounds,
}

/// Points (east, north, value) coloured by value / `limit`, on at most `most` pixels in either
/// direction; a pixel shows the mean of the points that cover it.
pub fn coloured(points: &[([f64; 2], f64)], limit: f64, bounds: Bounds, most: usize) -> Raster {
    means(points, (-limit, limit), bounds, most, &|share| {
        let [r, g, b] = diverging(2.0 * share - 1.0);
        [r, g, b, 255]
    })
}

/// As [`coloured`], for values from 0 to `limit`, dark to light.
pub fn graded(points: &[([f64; 2], f64)], limit: f64, bounds: Bounds, most: usize) -> Raster {
    means(points, (0.0, limit), bounds, most, &|share| {
        let [r, g, b] = grade(share);
        [r, g, b, 255]
    })
}

/// Points as pixels of one colour.
pub fn plain(points: &[[f64; 2]], bounds: Bounds, most: usize, colour: [u8; 4]) -> Raster {
    let points: Vec<([f64; 2], f64)> = points.iter().map(|p| (*p, 0.0)).collect();
    means(&points, (0.0, 1.0), bounds, most, &|_| colour)
}

/// A pixel shows the mean of the points that cover it, by its place between `low` and `high`.
fn means(
    points: &[([f64; 2], f64)],
    (low, high): (f64, f64),
    bounds: Bounds,
    most: usize,
    colour: &dyn Fn(f64) -> [u8; 4],
) -> Raster {
    let grid = Grid::new(bounds, most);
    let usable = points.iter().filter(|(_, v)| v.is_finite());
    let reach = grid.reach(usable.clone().map(|(p, _)| *p));
    let mut sum = vec![(0.0f64, 0u32); grid.width * grid.height];
    for (p, value) in usable {
        let Some((column, row)) = grid.pixel(*p) else {
            continue;
        };
        for r in row.saturating_sub(reach)..=(row + reach).min(grid.height - 1) {
            for c in column.saturating_sub(reach)..=(column + reach).min(grid.width - 1) {
                let cell = &mut sum[r * grid.width + c];
                cell.0 += value;
                cell.1 += 1;
            }
        }
    }
    let pixels = sum.iter().map(|&(total, n)| {
        if n == 0 {
            return EMPTY;
        }
        let share = (total / f64::from(n) - low) / (high - low);
        (share.clamp(0.0, 1.0) * (LEVELS - 1) as f64).round() as u8
    });
    raster(&grid, pixels.collect(), colour)
}

/// Points shaded by their height from `low` to `high`; a pixel shows its highest point.
pub fn heights(points: &[Vec3], [low, high]: [f64; 2], bounds: Bounds, most: usize) -> Raster {
    let grid = Grid::new(bounds, most);
    let usable = points.iter().filter(|p| p.z.is_finite());
    let reach = grid.reach(usable.clone().map(|p| [p.x, p.y]));
    let mut highest = vec![f64::NEG_INFINITY; grid.width * grid.height];
    for p in usable {
        let Some((column, row)) = grid.pixel([p.x, p.y]) else {
            continue;
        };
        for r in row.saturating_sub(reach)..=(row + reach).min(grid.height - 1) {
            for c in column.saturating_sub(reach)..=(column + reach).min(grid.width - 1) {
                let cell = &mut highest[r * grid.width + c];
                *cell = cell.max(p.z);
            }
        }
    }
    let pixels = highest.iter().map(|&up| {
        if up == f64::NEG_INFINITY {
            return EMPTY;
        }
        let share = ((up - low) / (high - low).max(1e-6)).clamp(0.0, 1.0);
        (share * (LEVELS - 1) as f64).round() as u8
    });
    raster(&grid, pixels.collect(), &shade)
}

/// Red, green, blue and opacity of a height `share` in [0, 1]: brown, more opaque where higher, for
/// light and dark pages.
fn shade(share: f64) -> [u8; 4] {
    [150, 104, 40, (26.0 + 204.0 * share).round() as u8]
}

/// [`shade`] as a CSS colour.
pub fn shade_css(share: f64) -> String {
    let [r, g, b, a] = shade(share);
    format!("rgba({r},{g},{b},{:.2})", f64::from(a) / 255.0)
}

fn raster(grid: &Grid, pixels: Vec<u8>, colour: &dyn Fn(f64) -> [u8; 4]) -> Raster {
    let png = encode(grid.width as u32, grid.height as u32, &pixels, colour);
    let text = base64::engine::general_purpose::STANDARD.encode(png);
    Raster {
        uri: format!("data:image/png;base64,{text}"),
        extent: grid.extent(),
    }
}

/// Encodes an indexed PNG with [`LEVELS`] evenly spaced colours and a transparent one.
fn encode(width: u32, height: u32, pixels: &[u8], colour: &dyn Fn(f64) -> [u8; 4]) -> Vec<u8> {
    let colours: Vec<[u8; 4]> = (0..LEVELS)
        .map(|level| colour(level as f64 / (LEVELS - 1) as f64))
        .chain([[0; 4]])
        .collect();
    let palette: Vec<u8> = colours.iter().flat_map(|c| [c[0], c[1], c[2]]).collect();
    let alpha: Vec<u8> = colours.iter().map(|c| c[3]).collect();

    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(palette);
    encoder.set_trns(alpha);
    encoder.set_compression(png::Compression::High);
    // Filters do not help with palette indices.
    encoder.set_filter(png::Filter::NoFilter);
    // The size is positive and matches the pixels, and writing to memory cannot fail.
    let _ = encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(pixels));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(uri: &str) -> (u32, u32, Vec<u8>) {
        let text = uri.strip_prefix("data:image/png;base64,").unwrap();
        let bytes = base64::engine::general_purpose::STANDARD
            .decode(text)
            .unwrap();
        let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        decoder.set_transformations(png::Transformations::IDENTITY);
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.width, info.height, pixels)
    }

    #[test]
    fn the_scale_is_blue_below_grey_at_zero_red_above() {
        let [low, zero, high] = [diverging(-1.0), diverging(0.0), diverging(1.0)];
        assert!(low[2] > low[0] && high[0] > high[2]);
        assert!(zero.iter().all(|c| (200..=220).contains(c)));
        assert_eq!(diverging(7.0), high);
        assert_eq!(diverging(f64::NAN), zero);
    }

    #[test]
    fn north_is_up_and_colours_stand_where_the_points_are() {
        let points = [
            ([0.0, 0.0], -1.0),
            ([10.0, 5.0], 1.0),
            ([5.0, 2.0], f64::NAN),
        ];
        let bounds = Bounds::around(points.iter().map(|(p, _)| *p)).unwrap();
        let raster = coloured(&points, 1.0, bounds, 100);
        let (width, height, pixels) = decode(&raster.uri);
        assert_eq!((width, height), (100, 51));
        let painted = |level: u8| {
            let mut all = pixels.iter().enumerate().filter(|(_, p)| **p == level);
            all.next()
                .map(|(i, _)| (i as u32 % width, i as u32 / width))
        };
        let (west, south) = painted(0).unwrap();
        let (east, north) = painted(LEVELS as u8 - 1).unwrap();
        assert!(west < 10 && south > 40 && east > 90 && north < 10);
        assert_eq!(painted(LEVELS as u8 / 2), None);
    }

    #[test]
    fn a_pixel_shows_its_highest_point() {
        let points = [
            Vec3::zeros(),
            Vec3::new(10.0, 5.0, 0.3),
            Vec3::new(10.0, 5.0, 1.0),
        ];
        let bounds = Bounds::around(points.iter().map(|p| [p.x, p.y])).unwrap();
        let (_, _, pixels) = decode(&heights(&points, [0.0, 1.0], bounds, 100).uri);
        let painted = |level: usize| pixels.iter().any(|p| usize::from(*p) == level);
        assert!(painted(0) && painted(LEVELS - 1));
        assert!(!painted((0.3 * (LEVELS - 1) as f64) as usize));
    }

    #[test]
    fn nothing_to_draw_has_no_bounds() {
        assert_eq!(Bounds::around([[f64::NAN, 0.0]].into_iter()), None);
        assert_eq!(Bounds::around(std::iter::empty()), None);
    }
}
