//! Writes the recordings of the scanners on a drive.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::describe;
use super::drive::Drive;
use super::lidar::Lidar;
use super::profiler::Profiler;
use super::scenario::Scenario;
use super::scene::Scene;
use super::sensors::ScannerKind;
use crate::error::{Error, Result};
use crate::format;
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Profiles of each scanner generated at a time.
const PROFILES_AT_ONCE: usize = 256;

/// Revolutions of a lidar generated at a time.
const REVOLUTIONS_AT_ONCE: usize = 32;

/// A robot with its scanners on a drive.
pub struct Robot<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// Its scene.
    pub scene: &'a Scene,
    /// The motion.
    pub drive: &'a Drive,
    /// Index of the drive.
    pub index: usize,
}

impl Robot<'_> {
    /// Writes the profiles of all profile scanners; returns the numbers of profiles and points.
    pub fn write_profiles(
        &self,
        at: &dyn Fn(&str) -> PathBuf,
        progress: &dyn Progress,
    ) -> Result<(u64, u64)> {
        let profiler = Profiler::new(self.scenario, self.scene, self.drive, self.index);
        let scanners = self.scenario.scanners_of(ScannerKind::Profile);
        let mut writers = scanners
            .iter()
            .map(|&scanner| {
                let name = describe::recording_name(&self.scenario.scanners[scanner]);
                Ok((scanner, format::BonnWriter::create(&at(&name))?))
            })
            .collect::<Result<Vec<_>>>()?;
        let profiles = (profiler.count() * scanners.len()) as u64;
        let name = describe::drive_name(self.index);
        let stage = progress.stage(&format!("simulating profiles of {name}"), profiles);
        let mut points = 0;
        for from in (0..profiler.count()).step_by(PROFILES_AT_ONCE) {
            let to = profiler.count().min(from + PROFILES_AT_ONCE);
            for (scanner, writer) in &mut writers {
                let chunk: Vec<_> = (from..to)
                    .into_par_iter()
                    .map(|k| profiler.profile(*scanner, k))
                    .collect();
                for profile in &chunk {
                    writer.write_profile(profile.time_s, &profile.points)?;
                    points += profile.points.iter().flatten().count() as u64;
                }
                stage.advance(chunk.len() as u64)?;
            }
        }
        for (_, writer) in writers {
            writer.finish()?;
        }
        Ok((profiles, points))
    }

    /// Writes the points of all lidars; returns their number.
    pub fn write_revolutions(
        &self,
        at: &dyn Fn(&str) -> PathBuf,
        progress: &dyn Progress,
    ) -> Result<u64> {
        let lidar = Lidar::new(self.scenario, self.scene, self.drive, self.index);
        let mut points = 0;
        for scanner in self.scenario.scanners_of(ScannerKind::Lidar) {
            let settings = &self.scenario.scanners[scanner];
            let path = at(&describe::recording_name(settings));
            let mut table = Table::create(&path)?;
            let name = describe::drive_name(self.index);
            let stage = format!("simulating the lidar {} of {name}", settings.name);
            let stage = progress.stage(&stage, lidar.count() as u64);
            for from in (0..lidar.count()).step_by(REVOLUTIONS_AT_ONCE) {
                let to = lidar.count().min(from + REVOLUTIONS_AT_ONCE);
                let chunk: Vec<_> = (from..to)
                    .into_par_iter()
                    .map(|k| lidar.revolution(scanner, k))
                    .collect();
                for (time_s, position_m) in chunk.iter().flatten() {
                    table.row(*time_s, position_m)?;
                    points += 1;
                }
                stage.advance((to - from) as u64)?;
            }
            table.finish()?;
        }
        Ok(points)
    }
}

/// The points of a lidar as a native table.
struct Table<'a> {
    path: &'a Path,
    out: BufWriter<File>,
}

impl<'a> Table<'a> {
    fn create(path: &'a Path) -> Result<Self> {
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        let mut out = BufWriter::with_capacity(1 << 18, file);
        writeln!(out, "time_s,x_m,y_m,z_m").map_err(|e| Error::io(path, e))?;
        Ok(Self { path, out })
    }

    /// Writes a point, rounded to a tenth of a millimetre and a microsecond, far below the noise.
    fn row(&mut self, time_s: f64, p: &Vec3) -> Result<()> {
        writeln!(self.out, "{time_s:.6},{:.4},{:.4},{:.4}", p.x, p.y, p.z)
            .map_err(|e| Error::io(self.path, e))
    }

    fn finish(mut self) -> Result<()> {
        self.out.flush().map_err(|e| Error::io(self.path, e))
    }
}
