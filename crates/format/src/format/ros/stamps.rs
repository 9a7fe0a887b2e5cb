//! Stamps of clouds that are wrong: repeated, or too early or too late by less than a clock would be.
//!
//! Clouds of a topic come at intervals, and some arrive after later ones. A cloud that is out of order is believed if its
//! stamp fills a gap between those of others. It is wrong if the clouds before and after it in the file leave a gap in
//! which it belongs, while its stamp is that of another cloud or far from all of them.

use std::collections::VecDeque;

/// Stamps of used clouds that are remembered.
const REMEMBERED: usize = 16;
/// Two clouds of a topic closer than this share of their usual interval have one place in time.
const SAME_PLACE: f64 = 0.6;
/// Closer than this share, they have one time that was rounded.
const SAME_TIME: f64 = 0.01;
/// Clouds further than this many intervals from all others are not merely late.
const FAR: f64 = 3.5;
/// An interval with room for another cloud, in usual intervals.
const GAP: f64 = 1.5;
/// A step that no pause of a sensor explains, seconds.
pub(super) const WRONG_STEP_S: f64 = 3600.0;

/// The stamps of the clouds that were used last, in the order of the file, seconds.
#[derive(Default)]
pub(super) struct Stamps(VecDeque<f64>);

impl Stamps {
    /// Adds the stamp of a cloud that is used.
    pub(super) fn push(&mut self, stamp_s: f64) {
        if self.0.len() == REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back(stamp_s);
    }

    /// Whether the stamp of the next cloud is wrong; `ahead_s` are the stamps of those after it.
    pub(super) fn is_wrong(&self, stamp_s: f64, ahead_s: &[f64]) -> bool {
        let mut others: Vec<f64> = self.0.iter().chain(ahead_s).copied().collect();
        let Some(interval_s) = usual_interval_s(&mut others) else {
            return false;
        };
        let (before_s, after_s) = (self.0.back().copied(), ahead_s.first().copied());
        let steps = |other_s: f64| (other_s - stamp_s).abs();
        let nearest_s = others
            .iter()
            .copied()
            .map(steps)
            .fold(f64::INFINITY, f64::min);
        let least_s = SAME_TIME * interval_s;
        let is_between = before_s.is_none_or(|before_s| stamp_s - before_s > least_s)
            && after_s.is_none_or(|after_s| after_s - stamp_s > least_s);
        if is_between {
            // The first or the last one may be far away from all others.
            return nearest_s > WRONG_STEP_S && (before_s.is_none() || after_s.is_none());
        }
        let is_far = nearest_s > FAR * interval_s;
        match before_s.zip(after_s) {
            Some((before_s, after_s)) => {
                let has_gap = after_s - before_s >= GAP * interval_s;
                has_gap && (is_far || nearest_s < SAME_PLACE * interval_s)
            }
            None => is_far,
        }
    }
}

/// The usual interval between these stamps, which are sorted; `None` if there are too few.
fn usual_interval_s(stamps_s: &mut [f64]) -> Option<f64> {
    stamps_s.sort_by(f64::total_cmp);
    let steps = stamps_s.windows(2).map(|pair| pair[1] - pair[0]);
    let mut steps: Vec<f64> = steps.filter(|step_s| *step_s > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    (steps.len() >= 2).then(|| steps[(steps.len() - 1) / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The stamps that are used of these, with three known ahead.
    fn used(stamps_s: &[f64]) -> Vec<f64> {
        let mut stamps = Stamps::default();
        let mut used = Vec::new();
        for (at, stamp_s) in stamps_s.iter().enumerate() {
            let ahead = &stamps_s[at + 1..stamps_s.len().min(at + 4)];
            if !stamps.is_wrong(*stamp_s, ahead) {
                stamps.push(*stamp_s);
                used.push(*stamp_s);
            }
        }
        used
    }

    #[test]
    fn one_wrong_stamp_is_found_wherever_it_is() {
        let right: Vec<f64> = (0..30).map(|i| 1.7e9 + 0.1 * f64::from(i)).collect();
        for by_s in [-1.7e9, -5.0, -0.85, -0.3, -0.15, -0.1, 0.15, 0.3, 5.0] {
            for at in 1..29 {
                let mut stamps_s = right.clone();
                stamps_s[at] += by_s;
                // Shortly before all others, it may be one that came late.
                let is_before_all = (1.7e9 - 0.36..1.7e9).contains(&stamps_s[at]);
                let mut expected = right.clone();
                expected.remove(at);
                if !is_before_all && (by_s < 0.0 || at < 26) {
                    assert_eq!(used(&stamps_s), expected, "{by_s} s at {at}");
                }
            }
        }
        assert_eq!(used(&[0.0, 1.7e9, 1.7e9 + 0.1, 1.7e9 + 0.2]).len(), 3);
        assert_eq!(used(&[1.7e9, 1.7e9 + 0.1, 0.0, 1.7e9 + 0.3]).len(), 3);
        assert_eq!(used(&[1.7e9, 1.7e9 + 0.1, 1.7e9 + 0.2, 0.0]).len(), 3);
    }

    #[test]
    fn late_clouds_and_those_of_two_scanners_are_used() {
        for stamps_s in [
            &[10.0, 12.0, 11.0, 9.0][..],
            &[1.0, 2.0, 4.0, 3.0, 6.0, 7.0],
            &[1.0, 1.5, 2.0, 3.0, 2.5, 3.5, 4.0],
            &[1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0],
            &[1.0, 1.1, 1.4, 2.0, 2.1, 9.0, 9.5],
        ] {
            assert_eq!(used(stamps_s), stamps_s);
        }
    }
}
