//! Drives with faults put in, and a judgement of their estimates against the truth.

use super::{Logs, Truth, rms};
use crate::common::consistency::error;
use boresight::geometry::Vec3;
use boresight::geometry::heading::wrap;
use boresight::sensor::{HeadingFix, ImuSample, PositionFix, Timed};
use boresight::trajectory::{Estimate, RejectionReason};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;

/// Whether a fault was put into a record, and which.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mark {
    Good,
    /// Its value is off by this many standard deviations.
    Off(f64),
    /// Its time stamp is wrong or a repetition.
    Stamp,
}

pub type Marked<T> = Vec<(T, Mark)>;

/// A drive with faults.
pub struct Faulty {
    pub imu: Marked<ImuSample>,
    pub prism: Marked<PositionFix>,
    pub heading: Marked<HeadingFix>,
    /// Time spans that a fault leaves with less data, seconds.
    pub affected: Vec<(f64, f64)>,
    pub random: ChaCha8Rng,
    pub sigma_m: f64,
    pub sigma_rad: f64,
    pub span_s: f64,
}

const MARGIN_S: f64 = 2.0;

impl Faulty {
    pub fn new(logs: &Logs, seed: u64) -> Self {
        fn good<T: Copy>(records: &[T]) -> Marked<T> {
            records.iter().map(|r| (*r, Mark::Good)).collect()
        }
        Self {
            imu: good(&logs.imu),
            prism: good(&logs.prism),
            heading: good(&logs.heading),
            affected: Vec::new(),
            random: ChaCha8Rng::seed_from_u64(1000 + seed),
            sigma_m: logs.settings.positions[0].sigma_m.x,
            sigma_rad: logs.settings.heading.sigma_rad,
            span_s: logs.imu[logs.imu.len() - 1].time_s,
        }
    }

    pub fn logs(&self, like: &Logs) -> Logs {
        fn plain<T: Copy>(records: &Marked<T>) -> Vec<T> {
            records.iter().map(|r| r.0).collect()
        }
        Logs {
            imu: plain(&self.imu),
            prism: plain(&self.prism),
            heading: plain(&self.heading),
            settings: like.settings.clone(),
        }
    }

    fn affect(&mut self, from_s: f64, to_s: f64) {
        self.affected.push((from_s - MARGIN_S, to_s + MARGIN_S));
    }

    fn is_affected(&self, time_s: f64) -> bool {
        self.affected
            .iter()
            .any(|(from, to)| (*from..=*to).contains(&time_s))
    }

    /// Multipath: one prism fix in ten off by 3 cm to 3 m in any direction.
    pub fn prism_outliers(&mut self) {
        self.prism_outliers_up_to(3.0);
    }

    /// One prism fix in ten off by 3 cm to `most_m` in any direction.
    pub fn prism_outliers_up_to(&mut self, most_m: f64) {
        for i in 0..self.prism.len() {
            if self.random.random::<f64>() < 0.1 {
                let mut normal = || -> f64 { StandardNormal.sample(&mut self.random) };
                let direction = Vec3::new(normal(), normal(), normal()).normalize();
                let size = 0.03 * (most_m / 0.03).powf(self.random.random::<f64>());
                self.displace(i, direction * size);
            }
        }
    }

    fn displace(&mut self, i: usize, by: Vec3) {
        self.prism[i].0.position_m += by;
        self.prism[i].1 = Mark::Off(by.norm() / self.sigma_m);
    }

    /// The total station follows another prism, 0.7 m away, for 5 s.
    pub fn wrong_target(&mut self) {
        for i in 0..self.prism.len() {
            if (20.0..25.0).contains(&self.prism[i].0.time_s) {
                self.displace(i, Vec3::new(0.5, -0.4, 0.29));
            }
        }
        self.affect(20.0, 25.0);
    }

    pub fn lock_lost(&mut self) {
        self.lock_lost_between(40.0, 70.0);
    }

    pub fn lock_lost_between(&mut self, from_s: f64, to_s: f64) {
        self.prism.retain(|f| !(from_s..to_s).contains(&f.0.time_s));
        self.affect(from_s, to_s);
    }

    pub fn imu_gap(&mut self, from_s: f64, to_s: f64) {
        self.imu.retain(|s| !(from_s..to_s).contains(&s.0.time_s));
        self.affect(from_s, to_s);
    }

    /// In every stream one record in a hundred is repeated and one is stamped up to 3 s early.
    pub fn stamps(&mut self) {
        fn corrupt<T: Copy>(
            records: &mut Marked<T>,
            random: &mut ChaCha8Rng,
            time: fn(&mut T) -> &mut f64,
        ) {
            let mut all = Vec::with_capacity(records.len());
            for record in records.iter() {
                all.push(*record);
                if random.random::<f64>() < 0.01 {
                    all.push((record.0, Mark::Stamp));
                }
                if random.random::<f64>() < 0.01 {
                    let last = all.len() - 1;
                    *time(&mut all[last].0) -= 0.1 + 2.9 * random.random::<f64>();
                    all[last].1 = Mark::Stamp;
                }
            }
            *records = all;
        }
        corrupt(&mut self.imu, &mut self.random, |r| &mut r.time_s);
        corrupt(&mut self.prism, &mut self.random, |r| &mut r.time_s);
        corrupt(&mut self.heading, &mut self.random, |r| &mut r.time_s);
    }

    fn flip(&mut self, i: usize) {
        self.heading[i].0.heading_rad = wrap(self.heading[i].0.heading_rad + PI);
        self.heading[i].1 = Mark::Off(PI / self.sigma_rad);
    }

    pub fn heading_flips(&mut self) {
        for i in 0..self.heading.len() {
            if self.random.random::<f64>() < 0.1 {
                self.flip(i);
            }
        }
    }

    pub fn heading_flipped_run(&mut self) {
        for i in 0..self.heading.len() {
            let first = self.heading[i].1 == Mark::Good;
            if first && (28.0..38.0).contains(&self.heading[i].0.time_s) {
                self.flip(i);
            }
        }
    }

    pub fn heading_dropout(&mut self) {
        self.heading
            .retain(|f| !(78.0..118.0).contains(&f.0.time_s));
    }

    pub fn prism_jump(&mut self, share: f64, by_s: f64) {
        let at = share * self.span_s;
        for fix in self.prism.iter_mut().filter(|f| f.0.time_s > at) {
            fix.0.time_s += by_s;
        }
        self.affect(at, at);
    }

    pub fn heading_jump(&mut self, share: f64, by_s: f64) {
        let at = share * self.span_s;
        for fix in self.heading.iter_mut().filter(|f| f.0.time_s > at) {
            fix.0.time_s += by_s;
        }
    }

    pub fn imu_jump(&mut self, share: f64, by_s: f64) {
        let at = share * self.span_s;
        for sample in self.imu.iter_mut().filter(|f| f.0.time_s > at) {
            sample.0.time_s += by_s;
        }
        self.affect(at, at);
    }
}

/// How an estimate compares with the truth and with the faults put in.
#[derive(Debug)]
pub struct Outcome {
    pub rmse_mm: f64,
    /// Largest normalised position error within the affected time spans and outside.
    pub worst: [f64; 2],
    /// Largest normalised tilt and yaw errors.
    pub worst_tilt: f64,
    pub worst_yaw: f64,
    /// Number of fixes and headings with a wrong value.
    pub injected: usize,
    /// Time and size in sigmas of those that are large enough to see but were not rejected.
    pub missed: Vec<(f64, f64)>,
    /// Number of good records that were rejected.
    pub wrongly: usize,
    pub good: usize,
    /// Number of records rejected for their time order, and of those with a wrong stamp.
    pub stamps: [usize; 2],
}

pub fn judge(f: &Faulty, estimate: &Estimate, truth: &dyn Fn(f64) -> Truth) -> Outcome {
    let mut errors = Vec::new();
    let mut worst = [0.0f64; 2];
    let (mut worst_tilt, mut worst_yaw) = (0.0f64, 0.0f64);
    for node in estimate.trajectory.poses() {
        let sigma = node.sigma.expect("sigma");
        let (miss, turn) = error(&node.world_from_body, &truth(node.time_s));
        let affected = f.is_affected(node.time_s);
        if !affected {
            errors.push(miss.norm());
        }
        let normalised = miss.component_div(&sigma.position_m).norm();
        let place = usize::from(!affected);
        worst[place] = worst[place].max(normalised);
        let turn = turn.component_div(&sigma.rotation_rad);
        worst_tilt = worst_tilt.max(turn.xy().norm());
        worst_yaw = worst_yaw.max(turn.z.abs());
    }
    let rejected = |sensor: &str, record: usize, reason: Option<RejectionReason>| {
        estimate.solution.rejections.iter().any(|r| {
            r.sensor == sensor && r.record == record + 1 && reason.is_none_or(|x| r.reason == x)
        })
    };
    let (mut injected, mut missed, mut wrongly, mut good) = (0, Vec::new(), 0, 0);
    let mut judge = |sensor: &str, records: &mut dyn Iterator<Item = (f64, Mark)>, sigma_m| {
        for (i, (time_s, mark)) in records.enumerate() {
            let out = rejected(sensor, i, Some(RejectionReason::Outlier));
            match mark {
                Mark::Off(sigmas) => {
                    injected += 1;
                    let local = estimate
                        .trajectory
                        .poses()
                        .iter()
                        .min_by(|a, b| {
                            (a.time_s - time_s)
                                .abs()
                                .total_cmp(&(b.time_s - time_s).abs())
                        })
                        .and_then(|n| n.sigma)
                        .map_or(0.0, |s| s.position_m.norm());
                    let visible = 6.0 * (1.0 + if sigma_m > 0.0 { local / sigma_m } else { 0.0 });
                    // A record logged twice is out of time order once.
                    if sigmas > visible && !rejected(sensor, i, None) {
                        missed.push((time_s, sigmas));
                    }
                }
                Mark::Good => {
                    good += 1;
                    wrongly += usize::from(out);
                }
                Mark::Stamp => {}
            }
        }
    };
    judge(
        "prism",
        &mut f.prism.iter().map(|r| (r.0.time_s, r.1)),
        f.sigma_m,
    );
    judge(
        "heading",
        &mut f.heading.iter().map(|r| (r.0.time_s, r.1)),
        0.0,
    );
    fn wrong_stamps<T: Timed>(records: &Marked<T>) -> usize {
        records.iter().filter(|r| r.1 == Mark::Stamp).count()
    }
    let wrong = wrong_stamps(&f.imu) + wrong_stamps(&f.prism) + wrong_stamps(&f.heading);
    let named = estimate
        .solution
        .rejections
        .iter()
        .filter(|r| r.reason == RejectionReason::TimeOrder)
        .count();
    Outcome {
        rmse_mm: rms(errors.into_iter()) * 1e3,
        worst,
        worst_tilt,
        worst_yaw,
        injected,
        missed,
        wrongly,
        good,
        stamps: [named, wrong],
    }
}
