//! Sections through the clouds at a moment of the calibration.

use std::collections::BTreeMap;

use crate::progress::EachPoint;
use crate::statistics::quantile;

/// Size of a picture, pixels.
const WIDTH: usize = 960;
const HEIGHT: usize = 400;
/// Width of a section, as a share of the clouds' extent, and its smallest and largest value, metres.
const EXTENT_SHARE: f64 = 0.1;
const LEAST_WIDTH_M: f64 = 0.2;
const MOST_WIDTH_M: f64 = 10.0;
/// Thickness of a section, as a share of its width.
const THICKNESS: f64 = 0.02;
/// The extent of the clouds is computed from one point in this many, without a share of `TAIL` at either end.
const EACH: usize = 101;
const TAIL: f64 = 0.05;
/// Smallest number of points with which a cloud covers a cell.
const LEAST_POINTS: u32 = 20;
/// Standard deviation of heights that a section shows, as a share of its width.
const SPREAD_SHARE: f64 = 0.12;
/// Edge of the square that shows a point, pixels.
const DOT: usize = 2;
/// Colours that colour-blind readers can also tell apart (Okabe and Ito); the reference is black.
const COLOURS: [[u8; 3]; 6] = [
    [0, 114, 178],
    [230, 159, 0],
    [0, 158, 115],
    [204, 121, 167],
    [86, 180, 233],
    [213, 94, 0],
];
const REFERENCE: &str = "reference";

/// A section through the clouds.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Description of the moment, for example "voxels of 50 mm".
    pub moment: String,
    /// Names of the clouds and their colours in CSS.
    pub legend: Vec<(String, String)>,
    /// Width and thickness, metres.
    pub size_m: [f64; 2],
    /// The picture as a PNG file.
    pub png: Vec<u8>,
}

/// Pictures of the same place.
#[derive(Debug, Default)]
pub struct Gallery {
    place: Option<Place>,
}

/// The place of sections: they extend from west to east, centred on it.
#[derive(Debug, Clone, Copy)]
struct Place {
    centre_m: [f64; 3],
    width_m: f64,
}

impl Gallery {
    /// A section through these clouds; `None` if they have no common ground or no points.
    pub fn picture(
        &mut self,
        moment: &str,
        names: &[&str],
        points: &EachPoint<'_>,
    ) -> Option<Picture> {
        let place = match self.place {
            Some(place) => place,
            None => Place::find(names.len(), points)?,
        };
        self.place = Some(place);
        let colours: Vec<[u8; 3]> = (0..).zip(names).map(|(i, name)| colour(i, name)).collect();
        let legend = names
            .iter()
            .zip(&colours)
            .map(|(name, [r, g, b])| ((*name).to_owned(), format!("#{r:02x}{g:02x}{b:02x}")));
        Some(Picture {
            moment: moment.to_owned(),
            legend: legend.collect(),
            size_m: [place.width_m, place.thickness_m()],
            png: encoded(&place.drawn(&colours, points))?,
        })
    }
}

fn colour(index: usize, name: &str) -> [u8; 3] {
    match name {
        REFERENCE => [0; 3],
        _ => COLOURS[index % COLOURS.len()],
    }
}

impl Place {
    /// Finds a place that all clouds cover, with a slope that is as steep as possible.
    fn find(clouds: usize, points: &EachPoint<'_>) -> Option<Self> {
        let mut axes: [Vec<f64>; 2] = Default::default();
        let mut count = 0;
        points(&mut |_, point| {
            if count % EACH == 0 && point.iter().all(|value| value.is_finite()) {
                axes[0].push(point[0]);
                axes[1].push(point[1]);
            }
            count += 1;
        });
        let extents_m = axes.iter_mut().map(|values| {
            values.sort_by(f64::total_cmp);
            if values.is_empty() {
                0.0
            } else {
                quantile(values, 1.0 - TAIL) - quantile(values, TAIL)
            }
        });
        let extent_m = extents_m.fold(0.0, f64::max);
        let width_m = (EXTENT_SHARE * extent_m).clamp(LEAST_WIDTH_M, MOST_WIDTH_M);

        let sizes_m = [width_m, THICKNESS * width_m];
        let mut cells: BTreeMap<[i64; 2], Cell> = BTreeMap::new();
        points(&mut |cloud, [east, north, up]| {
            if !(east + north + up).is_finite() {
                return;
            }
            let key = [east / sizes_m[0], north / sizes_m[1]].map(|value| value.floor() as i64);
            let cell = cells.entry(key).or_insert_with(|| Cell::new(clouds));
            if let Some(count) = cell.counts.get_mut(cloud) {
                *count += 1;
            }
            cell.sum += up;
            cell.squares += up * up;
        });
        let ranks = cells
            .iter()
            .map(|(key, cell)| (cell.rank(width_m), key, cell));
        let by_rank = |a: &(usize, f64), b: &(usize, f64)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1));
        let (_, key, cell) = ranks.max_by(|a, b| by_rank(&a.0, &b.0))?;
        let middle_m = |axis: usize| (key[axis] as f64 + 0.5) * sizes_m[axis];
        Some(Self {
            centre_m: [middle_m(0), middle_m(1), cell.mean()],
            width_m,
        })
    }

    fn thickness_m(self) -> f64 {
        THICKNESS * self.width_m
    }

    /// The pixels of the section: red, green and blue.
    fn drawn(self, colours: &[[u8; 3]], points: &EachPoint<'_>) -> Vec<u8> {
        let mut pixels = vec![255; 3 * WIDTH * HEIGHT];
        let per_m = WIDTH as f64 / self.width_m;
        let half_m = 0.5 * self.thickness_m();
        points(&mut |cloud, point| {
            let from_m: [f64; 3] = std::array::from_fn(|axis| point[axis] - self.centre_m[axis]);
            let (x, y) = (
                from_m[0] * per_m + WIDTH as f64 / 2.0,
                HEIGHT as f64 / 2.0 - from_m[2] * per_m,
            );
            let inside = (0.0..(WIDTH - DOT) as f64).contains(&x)
                && (0.0..(HEIGHT - DOT) as f64).contains(&y);
            // The condition is also false for NaN.
            if !(from_m[1].abs() <= half_m && inside) {
                return;
            }
            for row in 0..DOT {
                let at = 3 * ((y as usize + row) * WIDTH + x as usize);
                for pixel in pixels[at..at + 3 * DOT].chunks_exact_mut(3) {
                    pixel.copy_from_slice(&colours[cloud.min(colours.len() - 1)]);
                }
            }
        });
        pixels
    }
}

/// The data of a strip of the ground.
struct Cell {
    counts: Vec<u32>,
    sum: f64,
    squares: f64,
}

impl Cell {
    fn new(clouds: usize) -> Self {
        Self {
            counts: vec![0; clouds],
            sum: 0.0,
            squares: 0.0,
        }
    }

    fn points(&self) -> f64 {
        self.counts.iter().map(|count| f64::from(*count)).sum()
    }

    fn mean(&self) -> f64 {
        self.sum / self.points().max(1.0)
    }

    /// Number of clouds that cover the cell, and the spread of its heights, which counts less if it is too large for a
    /// section of this width.
    fn rank(&self, width_m: f64) -> (usize, f64) {
        let seen = self.counts.iter().filter(|count| **count >= LEAST_POINTS);
        let variance = self.squares / self.points().max(1.0) - self.mean().powi(2);
        let (spread_m, most_m) = (variance.max(0.0).sqrt(), SPREAD_SHARE * width_m);
        let shown = spread_m.min(most_m * most_m / spread_m.max(f64::MIN_POSITIVE));
        (seen.count(), shown)
    }
}

fn encoded(pixels: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, WIDTH as u32, HEIGHT as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(pixels).ok()?;
    writer.finish().ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two boards across a field, the second cloud this much above the first.
    fn field(apart_m: f64) -> impl Fn(&mut dyn FnMut(usize, [f64; 3])) {
        move |each| {
            for cloud in 0..2 {
                for i in 0..400 {
                    for j in 0..400 {
                        let (east, north) = (0.01 * f64::from(i), 0.01 * f64::from(j));
                        let board = (2.0..2.4).contains(&east) && (1.0..1.8).contains(&north);
                        let slope = if board { 0.2 * (east - 2.0) } else { 0.0 };
                        let up = slope + if cloud == 0 { 0.0 } else { apart_m };
                        each(cloud, [east, north, up]);
                    }
                }
            }
        }
    }

    fn pixels(png: &[u8]) -> Vec<u8> {
        let mut reader = png::Decoder::new(std::io::Cursor::new(png))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels
    }

    #[test]
    fn a_section_shows_how_far_clouds_lie_apart() {
        let mut gallery = Gallery::default();
        let names = ["left", REFERENCE];
        let height_of = |pixels: &[u8], colour: [u8; 3]| {
            let of_colour = pixels
                .chunks_exact(3)
                .enumerate()
                .filter(|(_, p)| **p == colour);
            let rows: Vec<f64> = of_colour.map(|(i, _)| (i / WIDTH) as f64).collect();
            assert!(rows.len() > 100, "{} pixels", rows.len());
            rows.iter().sum::<f64>() / rows.len() as f64
        };
        let mut apart = |apart_m: f64| {
            let picture = gallery.picture("a scale", &names, &field(apart_m)).unwrap();
            assert_eq!(
                picture.legend[1],
                (REFERENCE.to_owned(), "#000000".to_owned())
            );
            let pixels = pixels(&picture.png);
            let rows = height_of(&pixels, COLOURS[0]) - height_of(&pixels, [0; 3]);
            rows * picture.size_m[0] / WIDTH as f64
        };
        let far = apart(0.04);
        assert!((far - 0.04).abs() < 2e-3, "{far}");
        // The same place is used again, with clouds that agree better.
        let near = apart(0.01);
        assert!((near - 0.01).abs() < 2e-3, "{near}");
    }

    #[test]
    fn clouds_without_points_make_no_picture() {
        let mut gallery = Gallery::default();
        assert!(gallery.picture("none", &["left"], &|_| {}).is_none());
        let lost = |each: &mut dyn FnMut(usize, [f64; 3])| each(0, [f64::NAN; 3]);
        assert!(gallery.picture("lost", &["left"], &lost).is_none());
        let one = |each: &mut dyn FnMut(usize, [f64; 3])| each(0, [1.0, 2.0, 3.0]);
        assert!(gallery.picture("one", &["left"], &one).is_some());
    }
}
