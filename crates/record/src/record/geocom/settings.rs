//! Settings of tracking.

use std::time::Duration;

use crate::error::{Error, Result};

/// Settings of tracking.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackingSettings {
    /// `EDM_MODE` for continuous distances; 9, the default, is fast repeated measurement. `None` leaves
    /// the mode unchanged.
    pub edm_mode: Option<u16>,
    /// `BAP_USER_MEASPRG`, for example 10, synchronous tracking. A program also sets the mode of the
    /// distance meter, so that `edm_mode` must be `None`. `None`, the default, leaves the program unchanged.
    pub program: Option<u16>,
    /// `BAP_PRISMTYPE`, for example 3 (360° prism) or 7 (360° mini prism). `None`, the default,
    /// leaves the type unchanged.
    pub prism_type: Option<u16>,
    /// Whether to follow the prism; true by default.
    pub lock: bool,
    /// Half-widths of the window that is searched for the prism, along Hz and V, rad.
    pub search_rad: [f64; 2],
    /// Whether to search the full circle (PowerSearch) if the prism is not in that window.
    pub power_search: bool,
    /// Whether to request checksums; an instrument that does not support them is used without.
    pub checksum: bool,
    /// Longest time for a reply.
    pub reply_timeout: Duration,
    /// Longest time for a reply to a request that moves the telescope and searches.
    pub search_timeout: Duration,
    /// Longest time that the instrument waits for a distance before it returns only angles. Zero,
    /// the default, gives the most angles.
    pub wait: Duration,
    /// Shortest time from one request to the next.
    pub interval: Duration,
}

impl Default for TrackingSettings {
    fn default() -> Self {
        Self {
            edm_mode: Some(9),
            program: None,
            prism_type: None,
            lock: true,
            search_rad: [0.1, 0.1],
            power_search: false,
            checksum: false,
            reply_timeout: Duration::from_secs(2),
            search_timeout: Duration::from_secs(20),
            wait: Duration::ZERO,
            interval: Duration::from_millis(10),
        }
    }
}

/// Longest accepted time-out; no instrument needs longer.
const LONGEST_TIMEOUT: Duration = Duration::from_secs(600);

impl TrackingSettings {
    /// Checks the settings.
    ///
    /// # Errors
    /// [`Error::Data`] for the first setting that is out of range.
    pub(super) fn check(&self, port: &str) -> Result<()> {
        let times = [
            (
                "time-out of replies",
                self.reply_timeout,
                Duration::from_millis(1),
            ),
            (
                "time-out of searches",
                self.search_timeout,
                Duration::from_millis(1),
            ),
            ("time to wait for a distance", self.wait, Duration::ZERO),
            ("time between requests", self.interval, Duration::ZERO),
        ];
        for (name, found, least) in times {
            if !(least..=LONGEST_TIMEOUT).contains(&found) {
                return Err(Error::data(
                    format!("{port}: {name}: found {found:?}, expected {least:?} to 600 s"),
                    "change the setting",
                ));
            }
        }
        if !self
            .search_rad
            .iter()
            .all(|half| (0.0..=3.2).contains(half))
        {
            return Err(Error::data(
                format!(
                    "{port}: search window: found {:?} rad, expected 0 to 3.2",
                    self.search_rad
                ),
                "change the setting",
            ));
        }
        if let (Some(program), Some(_)) = (self.program, self.edm_mode) {
            return Err(Error::data(
                format!("{port}: found an EDM mode and program {program}, expected one of them"),
                "a program sets the EDM mode: omit one of them",
            ));
        }
        Ok(())
    }
}
