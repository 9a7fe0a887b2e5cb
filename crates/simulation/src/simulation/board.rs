//! Flat boards on the field.

use super::field::BoardSettings;
use crate::geometry::Vec3;

/// A flat board without thickness.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// Centre, metres.
    pub center_m: Vec3,
    /// Upward unit normal.
    pub normal: Vec3,
    /// Unit vectors along the two edges; the first is level.
    pub edges: [Vec3; 2],
    /// Half the length along each edge, metres.
    pub half_m: [f64; 2],
}

impl Board {
    /// The board as it stands during the reference scan: tilted against the horizon, with its normal
    /// inclined towards the azimuth.
    pub fn new(settings: &BoardSettings) -> Self {
        let azimuth = settings.azimuth_deg.to_radians();
        let (st, ct) = settings.tilt_deg.to_radians().sin_cos();
        let towards = Vec3::new(azimuth.sin(), azimuth.cos(), 0.0);
        let level = Vec3::new(azimuth.cos(), -azimuth.sin(), 0.0);
        let normal = towards * st + Vec3::z() * ct;
        Self {
            center_m: Vec3::from(settings.center_m),
            normal,
            edges: [level, normal.cross(&level)],
            half_m: settings.size_m.map(|s| 0.5 * s),
        }
    }

    /// The board as it stands during the drives.
    pub fn moved(settings: &BoardSettings) -> Self {
        let at_reference_scan = Self::new(settings);
        Self {
            center_m: at_reference_scan.center_m + Vec3::from(settings.moved_m),
            ..at_reference_scan
        }
    }

    /// Coordinates along the edges and along the normal, from the centre, metres.
    pub fn coordinates_m(&self, point: &Vec3) -> [f64; 3] {
        let d = point - self.center_m;
        [
            d.dot(&self.edges[0]),
            d.dot(&self.edges[1]),
            d.dot(&self.normal),
        ]
    }

    /// The point with these coordinates along the edges.
    pub fn point_m(&self, u: f64, v: f64) -> Vec3 {
        self.center_m + self.edges[0] * u + self.edges[1] * v
    }

    /// Range along the unit vector `direction`; `None` if the ray misses the board.
    pub fn intersect(&self, origin: &Vec3, direction: &Vec3) -> Option<f64> {
        let closing = self.normal.dot(direction);
        if closing.abs() < 1e-12 {
            return None;
        }
        let range = self.normal.dot(&(self.center_m - origin)) / closing;
        let [u, v, _] = self.coordinates_m(&(origin + direction * range));
        (range >= 0.0 && u.abs() <= self.half_m[0] && v.abs() <= self.half_m[1]).then_some(range)
    }

    /// Whether the board, widened by `margin_m`, covers the point in plan view.
    pub fn covers(&self, x: f64, y: f64, margin_m: f64) -> bool {
        let d = Vec3::new(x - self.center_m.x, y - self.center_m.y, 0.0);
        // The point above or below in the board's plane.
        let on = d - Vec3::z() * (d.dot(&self.normal) / self.normal.z);
        on.dot(&self.edges[0]).abs() <= self.half_m[0] + margin_m
            && on.dot(&self.edges[1]).abs() <= self.half_m[1] + margin_m / self.normal.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boards_lean_towards_their_azimuth() {
        let board = Board::new(&BoardSettings {
            center_m: [1.0, 2.0, 0.5],
            tilt_deg: 30.0,
            azimuth_deg: 90.0,
            size_m: [1.0, 1.0],
            moved_m: [0.0; 3],
        });
        assert!((board.normal - Vec3::new(0.5, 0.0, 0.75f64.sqrt())).norm() < 1e-12);
        // Half a metre along the slope is 0.433 m in plan view.
        assert!(board.covers(1.42, 2.0, 0.0) && !board.covers(1.44, 2.0, 0.0));
        assert!(board.covers(1.0, 2.49, 0.0) && !board.covers(1.0, 2.51, 0.0));
        let [u, v, w] = board.coordinates_m(&board.point_m(0.2, -0.3));
        assert!((u - 0.2).abs() < 1e-12 && (v + 0.3).abs() < 1e-12 && w.abs() < 1e-12);
    }
}
