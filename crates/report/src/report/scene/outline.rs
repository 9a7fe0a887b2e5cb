//! The field of view of a profile scanner, from its points.

use crate::geometry::Vec3;
use crate::statistics::{median, quantile};

/// Number of directions in which the outline has a point.
const DIRECTIONS: usize = 24;
/// Share of points at either end that are left out, because single points lie far off.
const TAIL: f64 = 0.005;
/// Quantile of the distances in a direction: objects on the ground are nearer.
const FAR: f64 = 0.99;
/// Points of a fan lie in its plane within this share of their distance.
const FLAT: f64 = 0.01;

/// The distance of the far points in each direction, from one side of the fan to the other, in the scanner frame,
/// metres; empty if the points lie in no plane through the scanner, such as those of a rotating head, or all around it.
pub fn outline(points: impl Iterator<Item = Vec3> + Clone) -> Vec<Vec3> {
    let usable = points.filter(|p| p.norm().is_finite() && p.norm() > 0.0);
    let middle: Vec3 = usable.clone().map(|p| p.normalize()).sum();
    let Some(middle) = middle.try_normalize(1e-9) else {
        return Vec::new();
    };
    // Profiles lie in the plane of x and z.
    let aside = Vec3::y().cross(&middle);
    let Some(aside) = aside.try_normalize(1e-9) else {
        return Vec::new();
    };
    let off = median(usable.clone().map(|p| p.y.abs() / p.norm()));
    if off.is_none_or(|off| off > FLAT) {
        return Vec::new();
    }
    let polar: Vec<(f64, f64)> = usable
        .map(|p| (p.dot(&aside).atan2(p.dot(&middle)), p.x.hypot(p.z)))
        .collect();
    let mut angles: Vec<f64> = polar.iter().map(|p| p.0).collect();
    angles.sort_by(f64::total_cmp);
    let (from, to) = (quantile(&angles, TAIL), quantile(&angles, 1.0 - TAIL));
    let mut ranges = vec![Vec::new(); DIRECTIONS];
    for (angle, range) in polar {
        let place = (angle - from) / (to - from) * DIRECTIONS as f64;
        if (0.0..DIRECTIONS as f64).contains(&place) {
            ranges[place as usize].push(range);
        }
    }
    let at = |(i, mut ranges): (usize, Vec<f64>)| {
        let angle = from + (to - from) * (i as f64 + 0.5) / DIRECTIONS as f64;
        ranges.sort_by(f64::total_cmp);
        let range = quantile(&ranges, FAR);
        let end = range * (angle.cos() * middle + angle.sin() * aside);
        range.is_finite().then_some(end)
    };
    ranges.into_iter().enumerate().filter_map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fan_over_flat_ground_ends_at_the_ground() {
        let points = (-500..=500).map(|i| Vec3::new(f64::from(i) * 1e-3, 0.0, 0.8));
        let outline = outline(points);
        assert_eq!(outline.len(), DIRECTIONS);
        // Within the width of a direction, the distance of the ground grows by a centimetre towards either end.
        assert!(
            outline
                .iter()
                .all(|p| (p.z - 0.806).abs() < 7e-3 && p.y == 0.0),
            "{outline:?}"
        );
        let (first, last) = (outline[0].x, outline[DIRECTIONS - 1].x);
        assert!(
            first.min(last) < -0.44 && first.max(last) > 0.44,
            "{first} {last}"
        );
    }

    #[test]
    fn a_rotating_head_has_no_fan() {
        let around = (0..360).map(|i| f64::from(i).to_radians());
        let head = around.map(|a| Vec3::new(a.cos(), a.sin(), 0.1));
        assert!(outline(head).is_empty());
        assert!(outline(std::iter::empty()).is_empty());
    }
}
