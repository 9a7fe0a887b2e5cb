//! Online smoothing of a drive, record by record.

use std::io::Write;
use std::time::Instant;

use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::format;
use crate::geometry::Vec3;
use crate::pipeline::job::Job;
use crate::pipeline::outcome::{Options, Outcome};
use crate::pipeline::result;
use crate::pipeline::stages::write_trajectory;
use crate::progress::Progress;
use crate::sensor::{PoseRecord, Record};
use crate::statistics::quantile;
use crate::trajectory::{Jump, Online, OnlineOptions, TrajectorySettings, Update};

/// The smoother and its updates so far.
pub(super) struct Session<'a> {
    smoother: Online,
    origin_m: Vec3,
    rows: Option<&'a mut dyn Write>,
    /// Run time of each record that caused an update, milliseconds.
    times_ms: Vec<f64>,
    poses: Vec<PoseRecord>,
    relinearised: usize,
    /// The last reason why there was no pose yet.
    waits_for: Option<String>,
}

impl<'a> Session<'a> {
    pub(super) fn new(
        settings: &TrajectorySettings,
        origin_m: Vec3,
        rows: Option<&'a mut dyn Write>,
    ) -> Result<Self> {
        Ok(Self {
            smoother: Online::new(settings, OnlineOptions::default())?,
            origin_m,
            rows,
            times_ms: Vec::new(),
            poses: Vec::new(),
            relinearised: 0,
            waits_for: None,
        })
    }

    pub(super) fn add(&mut self, record: Record, progress: &dyn Progress) -> Result<()> {
        progress.check()?;
        let begun = Instant::now();
        let updates = self.smoother.take(record)?;
        if updates.is_empty() {
            self.say_why_it_waits(progress);
            return Ok(());
        }
        self.times_ms.push(begun.elapsed().as_secs_f64() * 1e3);
        for update in &updates {
            self.record(update, progress)?;
        }
        Ok(())
    }

    /// Tells the user why there are no poses yet.
    fn say_why_it_waits(&mut self, progress: &dyn Progress) {
        let why = self.smoother.waits_for();
        if self.rows.is_none() || why == self.waits_for.as_deref() {
            return;
        }
        if let Some(why) = why {
            progress.say(&format!("no pose yet: {why}"));
        }
        self.waits_for = why.map(str::to_owned);
    }

    fn record(&mut self, update: &Update, progress: &dyn Progress) -> Result<()> {
        let mut pose = update.pose;
        pose.world_from_body.translation_m += self.origin_m;
        self.relinearised += update.relinearised;
        for rejection in &update.rejected {
            let size = rejection
                .normalised
                .map_or_else(String::new, |n| format!(", {n:.1} sigma"));
            progress.say(&format!(
                "{} record {} at {:.3} s: {}{size}",
                rejection.sensor, rejection.record, rejection.time_s, rejection.reason
            ));
        }
        for Jump { sensor, time_s } in &update.jumps {
            progress.warn(&format!(
                "at {time_s:.3} s: the estimate contradicted {sensor} for too long and was reset to it"
            ));
        }
        if let Some(rows) = &mut self.rows {
            let first = self.poses.is_empty();
            write_row(rows, &pose, first).map_err(|error| Error::io("stdout", error))?;
        }
        // A late fix updates the last pose.
        match self.poses.last_mut() {
            Some(last) if last.time_s >= pose.time_s => *last = pose,
            _ => self.poses.push(pose),
        }
        Ok(())
    }

    /// Estimates the whole trajectory and writes the files.
    pub(super) fn finish(
        self,
        options: &Options,
        job: Job<'_>,
        live: bool,
        progress: &dyn Progress,
    ) -> Result<Outcome> {
        let rejected = self.smoother.rejections().to_vec();
        let jumps = self.smoother.jumps().to_vec();
        let estimate = self.smoother.finish(progress)?;
        let mut files = Vec::new();
        let path = job.path("trajectory.csv");
        write_trajectory(&path, estimate.trajectory.poses(), &self.origin_m)?;
        files.push(options.out.join("trajectory.csv"));
        if !self.poses.is_empty() {
            format::write_trajectory(&job.path("online.csv"), &self.poses)?;
            files.push(options.out.join("online.csv"));
        }
        job.commit()?;
        let mut sorted_ms = self.times_ms;
        sorted_ms.sort_unstable_by(f64::total_cmp);
        let [median_ms, p999_ms, most_ms] = [0.5, 0.999, 1.0].map(|p| quantile(&sorted_ms, p));
        let solution = &estimate.solution;
        let (first_s, last_s) = estimate.trajectory.span_s();
        let nodes = estimate.trajectory.poses().len();
        let mut summary = format!(
            "{} updates, median {:.3} ms, 99.9 % {:.3} ms; {} records rejected, {} jumps\n{nodes} \
             poses over {:.1} s; {solution}",
            sorted_ms.len(),
            median_ms,
            p999_ms,
            rejected.len(),
            jumps.len(),
            last_s - first_s,
        );
        if live {
            // Between rows of numbers, text is written as a comment.
            for file in files.drain(..) {
                summary.push_str(&format!("\nwrote {}", file.display()));
            }
            summary = format!("# {}", summary.replace('\n', "\n# "));
        }
        Ok(Outcome {
            result: json!({
                "online": {
                    "updates": sorted_ms.len(),
                    "update_ms_median": number(median_ms),
                    "update_ms_p999": number(p999_ms),
                    "update_ms_max": number(most_ms),
                    "relinearised": self.relinearised,
                    "rejected": rejected,
                    "jumps": jumps,
                },
                "trajectory": result::solution(solution),
                "poses": nodes,
                "span_s": [first_s, last_s],
            }),
            summary,
            files,
            ..Outcome::default()
        })
    }
}

/// `null` for NaN.
fn number(x: f64) -> Value {
    if x.is_nan() { Value::Null } else { json!(x) }
}

/// Writes time, position, attitude and standard deviations as a line, and flushes it.
fn write_row(rows: &mut dyn Write, pose: &PoseRecord, first: bool) -> std::io::Result<()> {
    if first {
        writeln!(
            rows,
            "time_s,east_m,north_m,up_m,qx,qy,qz,qw,sigma_east_m,sigma_north_m,sigma_up_m,\
             sigma_rotation_east_rad,sigma_rotation_north_rad,sigma_rotation_up_rad"
        )?;
    }
    let (t, q) = (
        &pose.world_from_body.translation_m,
        &pose.world_from_body.rotation,
    );
    write!(
        rows,
        "{},{},{},{},{},{},{},{}",
        pose.time_s, t.x, t.y, t.z, q.i, q.j, q.k, q.w
    )?;
    if let Some(sigma) = &pose.sigma {
        for x in sigma.position_m.iter().chain(&sigma.rotation_rad) {
            write!(rows, ",{x}")?;
        }
    }
    writeln!(rows)?;
    rows.flush()
}
