//! A scene as bytes: one deflated stream, and a header with the place of each list.
//!
//! Lists of 16 and 32 bits are written as differences from one number to the next (modulo 2¹⁶ or 2³², the first from
//! 0), and these differences byte by byte: all lowest bytes, then all next bytes. Because neighbours resemble each
//! other, the higher bytes are nearly all the same and compress well.

use std::io::Write as _;

use base64::Engine as _;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde_json::{Value, json};

use super::quantised::{Bytes, Places, ROTATION_STEP, Range16, Track};
use super::{Fan, REFERENCE_STEP_M, Scene, Variant};
use crate::geometry::{BodyFromScanner, Vec3};

/// A scene in the form in which it is embedded in the page.
#[derive(Debug)]
pub struct Packed {
    /// The contents of the stream and their places.
    pub header: Value,
    /// The bytes of its lists, deflated (zlib).
    pub deflated: Vec<u8>,
}

impl Packed {
    /// Packs a scene, with the names of its variants.
    pub fn of(scene: &Scene, name: &str, variant_names: &[&str]) -> Self {
        let mut lists = Lists::default();
        let fans: Vec<Value> = scene.fans.iter().map(|fan| lists.fan(fan)).collect();
        let sets = scene.poses.iter();
        let poses: Vec<Vec<Value>> = sets.map(|set| lists.tracks(set)).collect();
        let variants = scene.variants.iter().zip(variant_names);
        let variants: Vec<Value> = variants.map(|(v, name)| lists.variant(v, name)).collect();
        let places = scene.places.iter().map(|place| {
            json!({
                "name": place.name,
                "centre_m": vector(&place.centre_m),
                "slope_rad": place.slope_rad,
                "seen": place.seen,
            })
        });
        let header = json!({
            "name": name,
            "origin_m": vector(&scene.origin_m),
            "step_m": scene.step_m,
            "rotation_step": ROTATION_STEP,
            "start_s": scene.start_s,
            "step_s": scene.step_s,
            "fans": fans,
            "poses": poses,
            "variants": variants,
            "against": scene.against,
            "reference": {
                "of": scene.reference_of,
                "step_m": REFERENCE_STEP_M,
                "axes": lists.axes(&scene.reference),
            },
            "surfels": {
                "size_m": scene.surfels.sizes.high,
                "sizes": lists.plain(&scene.surfels.sizes.values),
                "step_m": REFERENCE_STEP_M,
                "axes": lists.axes(&scene.surfels.centres),
                "normals": scene.surfels.normals.each_ref().map(|list| lists.plain(list)),
                "low": scene.surfels.roughness.low,
                "high": scene.surfels.roughness.high,
                "roughness": lists.plain(&scene.surfels.roughness.values),
            },
            "places": places.collect::<Vec<_>>(),
            "place_radius_m": scene.place_radius_m,
            "bytes": lists.bytes.len(),
        });
        Self {
            header,
            deflated: deflated(&lists.bytes),
        }
    }

    /// The bytes in base64.
    pub fn base64(&self) -> String {
        base64::engine::general_purpose::STANDARD.encode(&self.deflated)
    }
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    // Writing to memory cannot fail.
    let _ = encoder.write_all(bytes);
    encoder.finish().unwrap_or_default()
}

fn vector(v: &Vec3) -> [f64; 3] {
    (*v).into()
}

fn transform(pose: &BodyFromScanner) -> Value {
    json!({
        "translation_m": vector(&pose.translation_m),
        "rotation": <[f64; 4]>::from(pose.rotation.coords),
    })
}

/// Lists, one after the other.
#[derive(Default)]
struct Lists {
    bytes: Vec<u8>,
}

impl Lists {
    /// Appends numbers of `width` bytes each; returns their place.
    fn put(&mut self, width: usize, numbers: impl Iterator<Item = u32>) -> Value {
        let mut last = 0_u32;
        let differences: Vec<[u8; 4]> = numbers
            .map(|number| {
                let difference = number.wrapping_sub(last);
                last = number;
                difference.to_le_bytes()
            })
            .collect();
        let at = self.bytes.len();
        for plane in 0..width {
            self.bytes
                .extend(differences.iter().map(|bytes| bytes[plane]));
        }
        json!({ "at": at, "length": differences.len(), "bits": 8 * width })
    }

    fn shorts(&mut self, numbers: &[u16]) -> Value {
        self.put(2, numbers.iter().map(|&x| u32::from(x)))
    }

    fn integers(&mut self, numbers: &[i32]) -> Value {
        self.put(4, numbers.iter().map(|&x| x as u32))
    }

    /// Appends bytes unchanged; returns their place.
    fn plain(&mut self, bytes: &[u8]) -> Value {
        let at = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        json!({ "at": at, "length": bytes.len(), "bits": 8 })
    }

    fn range(&mut self, range: &Range16) -> Value {
        let values = if range.values.is_empty() {
            Value::Null
        } else {
            self.shorts(&range.values)
        };
        json!({ "low": range.low, "high": range.high, "values": values })
    }

    fn fan(&mut self, fan: &Fan) -> Value {
        let [x, y, z] = fan.coordinates.each_ref().map(|range| self.range(range));
        let points: usize = fan.counts.iter().map(|&n| usize::from(n)).sum();
        json!({
            "name": fan.name,
            "of": fan.total,
            "points": points,
            "x_m": x,
            "y_m": y,
            "z_m": z,
            "counts": self.shorts(&fan.counts),
            "times": self.integers(&fan.times),
            "numbers": self.integers(&fan.numbers),
            "passes": self.shorts(&fan.passes),
        })
    }

    fn axes(&mut self, places: &Places) -> [Value; 3] {
        places.axes.each_ref().map(|axis| self.integers(axis))
    }

    fn tracks(&mut self, tracks: &[Track]) -> Vec<Value> {
        let one = |track: &Track| {
            json!({
                "translation": self.axes(&track.places),
                "rotation": track.rotations.each_ref().map(|list| self.integers(list)),
            })
        };
        tracks.iter().map(one).collect()
    }

    fn variant(&mut self, variant: &Variant, name: &str) -> Value {
        let distance = self.attribute("M3C2 distance", "m", &variant.distances);
        let detection = self.attribute("level of detection", "m", &variant.detections);
        let omnivariance = self.attribute("omnivariance", "mm²", &variant.omnivariances);
        let pose_sigma = self.attribute("pose sigma", "m", &variant.pose_sigmas);
        json!({
            "name": name,
            "poses": variant.poses,
            "mountings": variant.mountings.iter().map(transform).collect::<Vec<_>>(),
            "moving": self.tracks(&variant.moving),
            "attributes": [distance, detection, omnivariance, pose_sigma],
        })
    }

    /// Appends a value for each point.
    fn attribute(&mut self, name: &str, unit: &str, fans: &[Bytes]) -> Value {
        let values: Vec<Value> = fans.iter().map(|fan| self.plain(&fan.values)).collect();
        let ends = fans.first().map_or((0.0, 0.0), |fan| (fan.low, fan.high));
        json!({ "name": name, "unit": unit, "low": ends.0, "high": ends.1, "values": values })
    }
}
