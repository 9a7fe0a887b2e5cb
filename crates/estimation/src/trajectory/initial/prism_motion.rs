//! The motion of the prism: local parabolas through its fixes.

use super::neighbours::agrees_with_neighbours;
use crate::geometry::Vec3;
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::streams::Streams;

/// Fixes on either side of the middle of a local parabola.
const PARABOLA_REACH: usize = 2;
/// Fixes farther away in time are left out of a parabola, seconds.
const PARABOLA_REACH_S: f64 = 1.0;

/// Position, velocity and acceleration of the prism at a time.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    pub time_s: f64,
    pub position_m: Vec3,
    pub velocity_m_s: Vec3,
    pub acceleration_m_s2: Vec3,
}

/// Times and positions of one point of the body, and its lever arm: of all sensors that share the lever
/// arm of the sensor with the most fixes, without fixes that lie far from their neighbours.
pub fn fixes(streams: &Streams, settings: &TrajectorySettings) -> (Vec<(f64, Vec3)>, Vec3) {
    let most = (0..streams.positions.len())
        .max_by_key(|&sensor| (streams.positions[sensor].len(), usize::MAX - sensor))
        .unwrap_or(0);
    let arm = settings.positions[most].lever_arm_m;
    let mut all: Vec<(f64, Vec3)> = streams
        .positions
        .iter()
        .zip(&settings.positions)
        .filter(|(_, sensor)| sensor.lever_arm_m == arm)
        .flat_map(|(fixes, _)| fixes.iter().map(|f| (f.value.time_s, f.value.position_m)))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let positions: Vec<Vec3> = all.iter().map(|f| f.1).collect();
    let agrees = agrees_with_neighbours(&positions, settings.positions[most].sigma_m.max());
    let agreeing = all.into_iter().zip(agrees).filter(|(_, agrees)| *agrees);
    (agreeing.map(|(fix, _)| fix).collect(), arm)
}

/// The least-squares parabola through the fixes near fix `middle`, at the time of that fix. With two
/// fixes it is a line, with one a point.
pub fn parabola(prism: &[(f64, Vec3)], middle: usize) -> Motion {
    let (time_s, position_m) = prism[middle];
    let first = middle.saturating_sub(PARABOLA_REACH);
    let last = (middle + PARABOLA_REACH + 1).min(prism.len());
    let near = || {
        prism[first..last]
            .iter()
            .map(|(t, p)| (t - time_s, p))
            .filter(|(t, _)| t.abs() <= PARABOLA_REACH_S)
    };
    let columns = near().count().min(3);
    let mut normal = nalgebra::Matrix3::zeros();
    let mut right = nalgebra::Matrix3::zeros();
    for (t, p) in near() {
        let row = Vec3::new(1.0, t, 0.5 * t * t);
        normal += row * row.transpose();
        right += row * p.transpose();
    }
    for unused in columns..3 {
        normal.row_mut(unused).fill(0.0);
        normal.column_mut(unused).fill(0.0);
        normal[(unused, unused)] = 1.0;
        right.row_mut(unused).fill(0.0);
    }
    let solution = normal.lu().solve(&right).unwrap_or_else(|| {
        nalgebra::Matrix3::from_rows(&[
            position_m.transpose(),
            Vec3::zeros().transpose(),
            Vec3::zeros().transpose(),
        ])
    });
    Motion {
        time_s,
        position_m: solution.row(0).transpose(),
        velocity_m_s: solution.row(1).transpose(),
        acceleration_m_s2: solution.row(2).transpose(),
    }
}

/// The motion at `time_s`: between fixes, the position follows Hermite's cubic, velocity and
/// acceleration are linear; beyond the ends, the prism rests. `cursor` remembers the place and may move
/// either way.
pub fn interpolated(motion: &[Motion], cursor: &mut usize, time_s: f64) -> Motion {
    let still = |m: &Motion| Motion {
        velocity_m_s: Vec3::zeros(),
        acceleration_m_s2: Vec3::zeros(),
        ..*m
    };
    let last = motion.len() - 1;
    if time_s <= motion[0].time_s {
        return still(&motion[0]);
    }
    if time_s >= motion[last].time_s {
        return still(&motion[last]);
    }
    while *cursor + 1 < last && motion[*cursor + 1].time_s <= time_s {
        *cursor += 1;
    }
    while *cursor > 0 && motion[*cursor].time_s > time_s {
        *cursor -= 1;
    }
    let (a, b) = (&motion[*cursor], &motion[*cursor + 1]);
    let dt = b.time_s - a.time_s;
    let u = (time_s - a.time_s) / dt;
    let (u2, u3) = (u * u, u * u * u);
    Motion {
        time_s,
        position_m: a.position_m * (2.0 * u3 - 3.0 * u2 + 1.0)
            + a.velocity_m_s * (dt * (u3 - 2.0 * u2 + u))
            + b.position_m * (3.0 * u2 - 2.0 * u3)
            + b.velocity_m_s * (dt * (u3 - u2)),
        velocity_m_s: a.velocity_m_s.lerp(&b.velocity_m_s, u),
        acceleration_m_s2: a.acceleration_m_s2.lerp(&b.acceleration_m_s2, u),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_reproduced_from_uneven_fixes() {
        let at = |t: f64| Vec3::new(1.0 + 2.0 * t + 3.0 * t * t, -t, 4.0);
        let prism: Vec<_> = [0.0, 0.1, 0.25, 0.4, 0.5].map(|t| (t, at(t))).to_vec();
        for (middle, &(t, p)) in prism.iter().enumerate() {
            let motion = parabola(&prism, middle);
            assert!((motion.position_m - p).norm() < 1e-9);
            assert!((motion.velocity_m_s - Vec3::new(2.0 + 6.0 * t, -1.0, 0.0)).norm() < 1e-9);
            assert!((motion.acceleration_m_s2 - Vec3::new(6.0, 0.0, 0.0)).norm() < 1e-9);
        }
        // A single fix gives a position but no velocity.
        let single = parabola(&[(0.0, at(0.0)), (5.0, at(5.0))], 0);
        assert!((single.position_m - at(0.0)).norm() < 1e-12);
        assert_eq!(single.velocity_m_s, Vec3::zeros());
    }
}
