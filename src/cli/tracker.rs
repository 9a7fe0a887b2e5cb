//! The running stages: the finished share of each, and the remaining time.
//!
//! Times are seconds since the program began; the caller passes them.

/// Time after which the rate of a stage is certain enough to estimate the remaining time, seconds.
const RATE_KNOWN_AFTER_S: f64 = 2.0;
/// Smallest share of an estimate to which the displayed time falls while its stage reports no progress.
const LEAST_LEFT: f64 = 0.1;
/// The remaining time is shown to rise only if it is longer by more than this factor and by more than this number of
/// seconds: smaller changes are noise.
const RISE_FACTOR: f64 = 1.5;
const RISE_S: f64 = 5.0;

/// The stages that are running.
#[derive(Debug, Default)]
pub(super) struct Tracker {
    stages: Vec<Stage>,
}

#[derive(Debug)]
struct Stage {
    name: String,
    began_s: f64,
    total: u64,
    done: u64,
    left: Countdown,
}

/// A stage that has ended.
#[derive(Debug, PartialEq)]
pub(super) struct Ended {
    /// Number of stages around it.
    pub depth: usize,
    pub name: String,
    pub took_s: f64,
}

/// The state of a stage for display.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shown {
    pub name: String,
    /// Start time; distinguishes repeated runs of a stage.
    pub began_s: f64,
    /// Time since it began, seconds.
    pub ran_s: f64,
    /// The finished share; `None` if it is unknown.
    pub share: Option<f64>,
    /// The remaining time, seconds; `None` if the rate is not known yet.
    pub left_s: Option<f64>,
}

impl Tracker {
    /// Begins a stage within the running ones; `total` is its number of work units, 0 if unknown.
    pub fn begin(&mut self, name: &str, total: u64, now_s: f64) {
        self.stages.push(Stage {
            name: name.to_owned(),
            began_s: now_s,
            total,
            done: 0,
            left: Countdown::default(),
        });
    }

    /// Adds finished units to the innermost stage.
    pub fn advance(&mut self, units: u64, now_s: f64) {
        let Some(stage) = self.stages.last_mut() else {
            return;
        };
        stage.done = stage.done.saturating_add(units);
        let ran_s = now_s - stage.began_s;
        if let Some(share) = stage.share().filter(|share| *share > 0.0)
            && ran_s > RATE_KNOWN_AFTER_S
        {
            stage.left.estimate(ran_s * (1.0 - share) / share, now_s);
        }
    }

    /// Ends the innermost stage; `None` if none is running.
    pub fn end(&mut self, now_s: f64) -> Option<Ended> {
        let stage = self.stages.pop()?;
        Some(Ended {
            depth: self.stages.len(),
            name: stage.name,
            took_s: now_s - stage.began_s,
        })
    }

    /// Number of running stages, each nested in the one before.
    pub fn depth(&self) -> usize {
        self.stages.len()
    }

    /// All running stages, innermost last.
    pub fn shown(&mut self, now_s: f64) -> Vec<Shown> {
        let shown = |stage: &mut Stage| Shown {
            name: stage.name.clone(),
            began_s: stage.began_s,
            ran_s: now_s - stage.began_s,
            share: stage.share(),
            left_s: stage.left.shown(now_s),
        };
        self.stages.iter_mut().map(shown).collect()
    }
}

impl Stage {
    fn share(&self) -> Option<f64> {
        (self.total > 0).then(|| (self.done as f64 / self.total as f64).min(1.0))
    }
}

/// One line about the stages, of which the innermost is last: their names, and the progress of the innermost stage that
/// has any; `None` if none is running.
pub(super) fn line(stages: &[Shown]) -> Option<String> {
    let innermost = stages.last()?;
    let names: Vec<&str> = stages.iter().map(|stage| stage.name.as_str()).collect();
    let names = names.join(", ");
    let counted = stages.iter().rev().find(|stage| stage.share.is_some());
    let Some((stage, share)) = counted.and_then(|stage| Some((stage, stage.share?))) else {
        return Some(format!("{names}: {} so far", duration(innermost.ran_s)));
    };
    let suffix = if std::ptr::eq(stage, innermost) {
        String::new()
    } else {
        format!(" of {}", stage.name)
    };
    let left = stage
        .left_s
        .map(|left_s| format!(", {}", time_left(left_s)));
    Some(format!(
        "{names}: {:.0} %{suffix}{}",
        (100.0 * share).floor(),
        left.unwrap_or_default()
    ))
}

/// "12 s left".
pub(super) fn time_left(seconds: f64) -> String {
    match seconds {
        ..99.5 => format!("{:.0} s left", seconds.round().max(1.0)),
        _ => format!("{} left", duration(seconds)),
    }
}

/// `seconds` as short text.
pub(super) fn duration(seconds: f64) -> String {
    if seconds < 9.95 {
        format!("{seconds:.1} s")
    } else if seconds < 99.5 {
        format!("{seconds:.0} s")
    } else {
        let minutes = (seconds / 60.0).round();
        if minutes < 100.0 {
            format!("{minutes} min")
        } else {
            format!("{:.1} h", seconds / 3600.0)
        }
    }
}

/// A remaining time that decreases.
///
/// The displayed time runs faster or slower than the clock, so that it reaches zero together with the newest estimate;
/// it rises only if the estimate is much longer.
#[derive(Debug, Default)]
struct Countdown {
    /// The newest estimate, and the time when it was made.
    estimate: Option<(f64, f64)>,
    /// The displayed value, and the time since when it is displayed.
    shown: Option<(f64, f64)>,
}

impl Countdown {
    fn estimate(&mut self, left_s: f64, now_s: f64) {
        self.shown(now_s);
        self.estimate = Some((left_s, now_s));
    }

    fn shown(&mut self, now_s: f64) -> Option<f64> {
        let (made, made_s) = self.estimate?;
        let least = LEAST_LEFT * made;
        let left_at = |at_s: f64| (made - (at_s - made_s)).max(least);
        let left = left_at(now_s);
        let Some((shown, shown_s)) = self.shown else {
            self.shown = Some((left, now_s));
            return Some(left);
        };
        let before = left_at(shown_s.max(made_s));
        // Both reach zero at the same time.
        let mut next = if before > 0.0 {
            shown * left / before
        } else {
            0.0
        };
        // Estimates that were too long are corrected within some seconds.
        if next > left {
            next -= (next - left) * (1.0 - (-(now_s - shown_s) / RISE_S).exp());
        }
        if left > RISE_FACTOR * next + RISE_S {
            next = left;
        }
        self.shown = Some((next, now_s));
        Some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The displayed remaining time at each half second of a stage whose units end at these times.
    fn shown_over(ends_s: &[f64]) -> Vec<(f64, f64)> {
        let mut tracker = Tracker::default();
        tracker.begin("calibrating", ends_s.len() as u64, 0.0);
        let (mut all, mut done, mut now_s) = (Vec::new(), 0, 0.0);
        while done < ends_s.len() {
            now_s += 0.5;
            while let Some(end_s) = ends_s.get(done).filter(|end_s| **end_s <= now_s) {
                tracker.advance(1, *end_s);
                done += 1;
            }
            let left_s = tracker.shown(now_s)[0].left_s;
            all.extend(left_s.map(|left_s| (now_s, left_s)));
        }
        all
    }

    #[test]
    fn an_even_stage_counts_down_by_the_clock() {
        let ends_s: Vec<f64> = (1..=100).map(|i| f64::from(i) * 0.4).collect();
        let shown = shown_over(&ends_s);
        assert_eq!(shown.len(), 76);
        for (now_s, left_s) in shown {
            assert!((left_s - (40.0 - now_s)).abs() < 1.0, "{left_s} at {now_s}");
        }
    }

    #[test]
    fn noise_never_makes_the_time_left_rise() {
        // Ten units of 0.36 s and ten of 0.44 s alternate.
        let mut now_s = 0.0;
        let mut ends_s = Vec::new();
        for i in 0..200 {
            now_s += if (i / 10) % 2 == 0 { 0.36 } else { 0.44 };
            ends_s.push(now_s);
        }
        let shown = shown_over(&ends_s);
        for pair in shown.windows(2) {
            assert!(pair[1].1 <= pair[0].1, "{pair:?}");
        }
        let (_, last) = shown[shown.len() - 1];
        assert!(last < 1.0, "{last}");
        // The estimate itself rises.
        let means = ends_s
            .iter()
            .zip(1..)
            .map(|(end_s, n)| end_s / f64::from(n) * f64::from(200 - n));
        let means: Vec<f64> = means.collect();
        assert!(means.windows(2).any(|pair| pair[1] > pair[0]));
    }

    #[test]
    fn the_time_left_rises_if_a_stage_becomes_much_slower() {
        // Half of the units take 10 s, the other half 100 s.
        let fast = (1..=50).map(|i| 0.2 * f64::from(i));
        let slow = (1..=50).map(|i| 10.0 + 2.0 * f64::from(i));
        let shown = shown_over(&fast.chain(slow).collect::<Vec<_>>());
        let rises = shown.windows(2).filter(|pair| pair[1].1 > pair[0].1);
        let rises = rises.count();
        assert!((1..=8).contains(&rises), "{rises}");
        let (_, last) = shown[shown.len() - 1];
        assert!(last < 3.0, "{last}");
    }

    #[test]
    fn a_stage_that_becomes_faster_ends_at_zero() {
        let slow = (1..=10).map(f64::from);
        let fast = (1..=90).map(|i| 10.0 + 0.1 * f64::from(i));
        let shown = shown_over(&slow.chain(fast).collect::<Vec<_>>());
        assert!(shown.windows(2).all(|pair| pair[1].1 <= pair[0].1));
        assert!(shown[shown.len() - 1].1 < 2.0, "{shown:?}");
    }

    #[test]
    fn a_line_shows_the_progress_that_is_known() {
        let mut tracker = Tracker::default();
        assert_eq!(line(&tracker.shown(1.0)), None);
        tracker.begin("evaluate drive-2", 0, 0.0);
        let line_at = |tracker: &mut Tracker, now_s| line(&tracker.shown(now_s)).unwrap();
        assert_eq!(line_at(&mut tracker, 3.0), "evaluate drive-2: 3.0 s so far");
        tracker.begin("joint adjustment", 100, 10.0);
        let nested = "evaluate drive-2, joint adjustment";
        tracker.advance(10, 11.0);
        assert_eq!(line_at(&mut tracker, 11.5), format!("{nested}: 10 %"));
        tracker.advance(33, 53.0);
        assert_eq!(
            line_at(&mut tracker, 53.0),
            format!("{nested}: 43 %, 57 s left")
        );
        tracker.begin("covariance", 0, 60.0);
        let nested = format!("{nested}, covariance: 43 % of joint adjustment, 50 s left");
        assert_eq!(line_at(&mut tracker, 60.0), nested);
        assert_eq!(tracker.end(61.0).unwrap().depth, 2);
        let ended = tracker.end(70.0).unwrap();
        assert_eq!((ended.depth, ended.took_s), (1, 60.0));
        tracker.end(70.0);
        assert_eq!(tracker.end(70.0), None);
    }

    #[test]
    fn durations_are_short() {
        for (seconds, text) in [
            (0.04, "0.0 s"),
            (9.94, "9.9 s"),
            (9.96, "10 s"),
            (99.0, "99 s"),
            (130.0, "2 min"),
            (7000.0, "1.9 h"),
        ] {
            assert_eq!(duration(seconds), text);
        }
        assert_eq!(time_left(0.2), "1 s left");
        assert_eq!(time_left(12.0), "12 s left");
        assert_eq!(time_left(600.0), "10 min left");
    }
}
