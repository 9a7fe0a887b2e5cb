//! The relation of two clocks from delayed messages.

/// A line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    /// At zero.
    pub(super) offset: f64,
    pub(super) slope: f64,
}

impl Line {
    /// Of all lines below the points (x, y), the one that is nearest to them in the mean: with x the time of a sensor and
    /// y the time of arrival less x, every y is the difference of the clocks and a delay that is never negative, and
    /// the least delays show the clocks (Moon, Skelly and Towsley, *Estimation and removal of clock skew from network
    /// delay measurements*, 1999). The line is the edge of the lower convex hull above the mean of x. There must be
    /// points; x need not be sorted.
    pub(super) fn below(points: &[(f64, f64)]) -> Self {
        let mut sorted = points.to_vec();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mean = sorted.iter().map(|p| p.0).sum::<f64>() / sorted.len() as f64;
        let mut hull: Vec<(f64, f64)> = Vec::new();
        for point in sorted {
            if hull.last().is_some_and(|last| last.0 == point.0) {
                continue;
            }
            while let [.., a, b] = hull[..]
                && (b.0 - a.0) * (point.1 - a.1) <= (b.1 - a.1) * (point.0 - a.0)
            {
                hull.pop();
            }
            hull.push(point);
        }
        let next = hull.partition_point(|p| p.0 <= mean).max(1);
        match (hull.get(next - 1), hull.get(next)) {
            (Some(a), Some(b)) => {
                let slope = (b.1 - a.1) / (b.0 - a.0);
                Self {
                    offset: a.1 - slope * a.0,
                    slope,
                }
            }
            (Some(a), None) => Self {
                offset: a.1,
                slope: 0.0,
            },
            (None, _) => Self {
                offset: 0.0,
                slope: 0.0,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::drawn;

    #[test]
    fn the_line_touches_the_least_delays_and_is_as_high_as_can_be() {
        // Uniform delays of up to 5 ms on a line; every tenth ten times as late.
        let random = |i: u64| (drawn(i) >> 11) as f64 / (1_u64 << 53) as f64;
        let points: Vec<(f64, f64)> = (0..6000)
            .map(|i| {
                let x = 0.1 * i as f64 - 300.0;
                let late = if i % 10 == 0 { 0.05 } else { 0.005 };
                (x, 12.5 + 4e-5 * x + late * random(i))
            })
            .collect();
        let found = Line::below(&points);
        let at = |x: f64| found.offset + found.slope * x;
        assert!(points.iter().all(|p| p.1 > at(p.0) - 1e-12));
        assert!((found.offset - 12.5).abs() < 2e-5, "{found:?}");
        assert!((found.slope - 4e-5).abs() < 1e-7, "{found:?}");
        // The slow way: of all lines through two points, the one below all others that is highest in the mean.
        let few = &points[..60];
        let mean = few.iter().map(|p| p.0).sum::<f64>() / 60.0;
        let mut best = f64::NEG_INFINITY;
        for a in few {
            for b in few.iter().filter(|b| b.0 > a.0) {
                let slope = (b.1 - a.1) / (b.0 - a.0);
                let height = |x: f64| a.1 + slope * (x - a.0);
                if few.iter().all(|p| p.1 >= height(p.0) - 1e-12) {
                    best = best.max(height(mean));
                }
            }
        }
        let found = Line::below(few);
        assert!((found.offset + found.slope * mean - best).abs() < 1e-12);
    }

    #[test]
    fn one_point_and_equal_times_give_a_constant() {
        assert_eq!(
            Line::below(&[(3.0, 2.0), (3.0, 1.0)]),
            Line {
                offset: 1.0,
                slope: 0.0
            }
        );
    }
}
