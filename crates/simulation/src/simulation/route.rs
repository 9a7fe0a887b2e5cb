//! Routes: straight passes over boards, joined by the shortest curves of bounded curvature.

use std::f64::consts::{FRAC_PI_2, TAU};

/// A position with a direction: east, north (m), yaw counter-clockwise from east (rad).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// East, metres.
    pub x: f64,
    /// North, metres.
    pub y: f64,
    /// Radians, counter-clockwise from east.
    pub yaw: f64,
}

/// A piece of constant curvature (1/m, positive to the left).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Length, metres.
    pub length_m: f64,
    /// Curvature, 1/m.
    pub curvature: f64,
}

impl Waypoint {
    /// The waypoint with this heading, degrees clockwise from north.
    pub fn heading(x: f64, y: f64, heading_deg: f64) -> Self {
        Self {
            x,
            y,
            yaw: FRAC_PI_2 - heading_deg.to_radians(),
        }
    }

    /// The waypoint `length_m` further along a circle, or straight on.
    pub fn along(&self, curvature: f64, length_m: f64) -> Self {
        let turn = curvature * length_m;
        // The chord of an arc deviates by half the turn.
        let chord = if turn == 0.0 {
            length_m
        } else {
            length_m * (0.5 * turn).sin() / (0.5 * turn)
        };
        let (s, c) = (self.yaw + 0.5 * turn).sin_cos();
        Self {
            x: self.x + chord * c,
            y: self.y + chord * s,
            yaw: self.yaw + turn,
        }
    }
}

/// The shortest curve of turns of `radius_m` and straight pieces from one waypoint to another
/// (Dubins 1957): turn, straight or opposite turn, turn.
pub fn shortest(from: &Waypoint, to: &Waypoint, radius_m: f64) -> Vec<Piece> {
    let (dx, dy) = ((to.x - from.x) / radius_m, (to.y - from.y) / radius_m);
    let d = dx.hypot(dy);
    let line = dy.atan2(dx);
    let turn = |angle: f64| {
        let a = angle.rem_euclid(TAU);
        // A full circle that rounding reduced to nothing.
        if TAU - a < 1e-9 { 0.0 } else { a }
    };
    let (a, b) = (turn(from.yaw - line), turn(to.yaw - line));
    let ((sa, ca), (sb, cb), cab) = (a.sin_cos(), b.sin_cos(), (a - b).cos());
    let mut words: Vec<[(f64, f64); 3]> = Vec::with_capacity(6);
    // Same turn at both ends: left is +1, right its mirror image.
    for side in [1.0, -1.0] {
        let (a, b, sa, sb) = (side * a, side * b, side * sa, side * sb);
        let square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb);
        if square >= 0.0 {
            let direction = (cb - ca).atan2(d + sa - sb);
            words.push([
                (side, turn(direction - a)),
                (0.0, square.sqrt()),
                (side, turn(b - direction)),
            ]);
        }
        let square = d * d - 2.0 + 2.0 * cab + 2.0 * d * (sa + sb);
        if square >= 0.0 {
            let p = square.sqrt();
            let direction = (-ca - cb).atan2(d + sa + sb) - (-2.0f64).atan2(p);
            words.push([
                (side, turn(direction - a)),
                (0.0, p),
                (-side, turn(direction - b)),
            ]);
        }
        let cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0;
        if cosine.abs() <= 1.0 {
            let p = TAU - cosine.acos();
            let t = turn((cb - ca).atan2(d + sa - sb) - a + 0.5 * p);
            words.push([(side, t), (-side, p), (side, turn(b - a - t + p))]);
        }
    }
    let pieces = |word: &[(f64, f64); 3]| -> Vec<Piece> {
        word.iter()
            .map(|&(side, angle)| Piece {
                length_m: angle * radius_m,
                curvature: side / radius_m,
            })
            .filter(|piece| piece.length_m > 0.0)
            .collect()
    };
    let length = |word: &[(f64, f64); 3]| word.iter().map(|w| w.1).sum::<f64>();
    words.sort_by(|x, y| length(x).total_cmp(&length(y)));
    words
        .iter()
        .map(pieces)
        .find(|pieces| arrives(from, to, pieces))
        .unwrap_or_default()
}

/// Whether the pieces end at the goal.
fn arrives(from: &Waypoint, to: &Waypoint, pieces: &[Piece]) -> bool {
    let end = pieces
        .iter()
        .fold(*from, |w, p| w.along(p.curvature, p.length_m));
    let turn = (end.yaw - to.yaw).rem_euclid(TAU);
    (end.x - to.x).hypot(end.y - to.y) < 1e-6 && turn.min(TAU - turn) < 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_goal_is_reached_by_a_short_way() {
        let from = Waypoint {
            x: 1.0,
            y: -2.0,
            yaw: 0.4,
        };
        for k in 0..400 {
            let (k, radius) = (f64::from(k), 0.9);
            let to = Waypoint {
                x: 1.0 + 3.0 * (k * 0.7).sin(),
                y: 2.5 * (k * 1.3).cos() - 2.0,
                yaw: k,
            };
            let pieces = shortest(&from, &to, radius);
            assert!(arrives(&from, &to, &pieces), "{to:?}");
            let length: f64 = pieces.iter().map(|p| p.length_m).sum();
            let straight = (to.x - from.x).hypot(to.y - from.y);
            // No such curve is longer than the distance plus two and a third circles.
            assert!(length >= straight - 1e-9 && length < straight + 7.0 / 3.0 * TAU * radius);
        }
    }

    #[test]
    fn straight_ahead_is_straight() {
        let from = Waypoint::heading(0.0, 0.0, 90.0);
        let pieces = shortest(&from, &from.along(0.0, 2.0), 0.5);
        let straight: f64 = pieces
            .iter()
            .filter(|p| p.curvature == 0.0)
            .map(|p| p.length_m)
            .sum();
        let all: f64 = pieces.iter().map(|p| p.length_m).sum();
        assert!((straight - 2.0).abs() < 1e-6 && (all - 2.0).abs() < 1e-6);
    }
}
