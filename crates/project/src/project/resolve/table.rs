//! A table of the project file: checks of its values, and errors for its keys.

use std::path::Path;

use crate::error::Result;
use crate::geometry::Vec3;
use crate::project::checked::LogFile;
use crate::project::source::{Source, Step};
use crate::trajectory::SENSOR_CORRELATION_S;

/// A table of the file, whose errors name the key.
pub(super) struct Table<'a> {
    pub source: &'a Source,
    pub name: &'a str,
    /// Index of the table if it is in an array.
    pub index: Option<usize>,
}

impl<'a> Table<'a> {
    pub fn new(source: &'a Source, name: &'a str) -> Self {
        let index = None;
        Self {
            source,
            name,
            index,
        }
    }

    pub fn error(
        &self,
        key: &str,
        found: impl Into<String>,
        expected: &str,
    ) -> crate::error::Error {
        let mut steps = vec![Step::Key(self.name)];
        steps.extend(self.index.map(Step::Index));
        steps.push(Step::Key(key));
        self.source.error(&steps, found, expected)
    }

    /// Returns `value` if it is finite and `is_valid`.
    pub fn number(
        &self,
        key: &str,
        value: f64,
        is_valid: fn(f64) -> bool,
        expected: &str,
    ) -> Result<f64> {
        if value.is_finite() && is_valid(value) {
            Ok(value)
        } else {
            Err(self.error(key, format!("{key} = {value}"), expected))
        }
    }

    pub fn finite(&self, key: &str, value: Option<f64>) -> Result<f64> {
        self.number(key, value.unwrap_or(0.0), |_| true, "a finite number")
    }

    pub fn positive(&self, key: &str, value: f64) -> Result<f64> {
        self.number(key, value, |x| x > 0.0, "a number above 0")
    }

    pub fn not_negative(&self, key: &str, value: f64) -> Result<f64> {
        self.number(key, value, |x| x >= 0.0, "0 or a number above 0")
    }

    /// The correlation time of the time-correlated part of a sensor's errors. It may be given only if the
    /// key of its sigma is given.
    pub fn correlation(&self, sigma: &str, given: bool, correlation_s: Option<f64>) -> Result<f64> {
        let key = "correlation_s";
        match correlation_s {
            None => Ok(SENSOR_CORRELATION_S),
            Some(seconds) if given => self.positive(key, seconds),
            Some(_) => Err(self.error(
                key,
                format!("{key} without {sigma}"),
                &format!("both: `{sigma}` is the standard deviation of the time-correlated errors"),
            )),
        }
    }

    /// A position on the body: no platform is larger than an airliner.
    pub fn on_body(&self, key: &str, value: [f64; 3]) -> Result<Vec3> {
        const LARGEST_M: f64 = 50.0;
        let position = self.vector(key, value)?;
        let longest = position.amax();
        if longest <= LARGEST_M {
            Ok(position)
        } else {
            Err(self.error(
                key,
                format!("{key} with {longest} m from the IMU"),
                "metres on the body, at most 50 (are these millimetres?)",
            ))
        }
    }

    pub fn vector(&self, key: &str, values: [f64; 3]) -> Result<Vec3> {
        for value in values {
            self.finite(key, Some(value))?;
        }
        Ok(values.into())
    }

    pub fn log(&self, file: &Path, time_offset_s: Option<f64>) -> Result<LogFile> {
        Ok(LogFile {
            path: self.source.absolute(file),
            time_offset_s: self.finite("time_offset_s", time_offset_s)?,
        })
    }
}
