//! The relation of two clocks from delayed messages.

/// A line y = offset + slope x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    pub(super) offset: f64,
    pub(super) slope: f64,
}

impl Line {
    /// The line that lies below all points (x, y) and is nearest to them in the mean. If x is the sensor time and y the
    /// arrival time less the sensor time, each y is the difference of the clocks plus a delay, which is never negative,
    /// so that the smallest delays show the difference (Moon, Skelly and Towsley, *Estimation and removal of clock skew
    /// from network delay measurements*, 1999). The line is the edge of the lower convex hull at the mean of x. x need
    /// not be sorted; without points, the line is zero.
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
    fn the_line_lies_below_all_delays_and_is_the_highest_such_line() {
        // Uniform delays of up to 5 ms on a line, of up to 50 ms for every tenth point.
        let random = |i: u64| (drawn(i) >> 11) as f64 / (1_u64 << 53) as f64;
        let points: Vec<(f64, f64)> = (0..6000)
            .map(|i| {
                let x = 0.1 * i as f64 - 300.0;
                let most = if i % 10 == 0 { 0.05 } else { 0.005 };
                (x, 12.5 + 4e-5 * x + most * random(i))
            })
            .collect();
        let line = Line::below(&points);
        let at = |x: f64| line.offset + line.slope * x;
        assert!(points.iter().all(|p| p.1 > at(p.0) - 1e-12));
        assert!((line.offset - 12.5).abs() < 2e-5, "{line:?}");
        assert!((line.slope - 4e-5).abs() < 1e-7, "{line:?}");
        // Brute force: of all lines through two points that lie below the others, the highest at the mean of x.
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
        let line = Line::below(few);
        assert!((line.offset + line.slope * mean - best).abs() < 1e-12);
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
