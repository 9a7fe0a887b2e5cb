//! Constants estimated beside the trajectory: columns of the dense border of the normal equations.

use super::clock::Trace;
use super::factors::PositionColumns;
use super::streams::{ClockCorrection, Names, Stream, Streams};
use crate::trajectory::{Constant, TrajectorySettings};

/// One scalar unknown.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Unknown {
    /// As in the project, with the component: `prism.lever_arm.x`.
    pub name: String,
    pub unit: &'static str,
    /// What the estimated correction is added to: the project's value, or for times the
    /// correction already made.
    pub base: f64,
    /// Standard deviation of the prior about the project's value: what a user may be off by.
    pub prior_sigma: f64,
}

/// The constants and which column of the border each has.
#[derive(Debug, Clone, Default)]
pub(super) struct Constants {
    pub unknowns: Vec<Unknown>,
    pub base_gravity_m_s2: f64,
    pub gravity: Option<usize>,
    pub heading_offset: Option<usize>,
    pub positions: Vec<PositionColumns>,
    /// Records of a stream from a number on are late by a column.
    late: Vec<(Stream, usize, usize)>,
}

/// What a user may be off by, the priors of the constants.
const PRIOR_TIME_S: f64 = 1.0;
const PRIOR_LEVER_ARM_M: f64 = 1.0;
const PRIOR_INCIDENCE_M: f64 = 0.02;
const PRIOR_OFFSET_RAD: f64 = 1.0;
const PRIOR_GRAVITY_M_S2: f64 = 0.1;

impl Constants {
    /// The constants that the settings ask for, and one for each correction of a clock.
    pub fn new(settings: &TrajectorySettings, corrections: &[ClockCorrection]) -> Self {
        let mut all = Self {
            base_gravity_m_s2: settings.gravity_m_s2,
            positions: vec![PositionColumns::default(); settings.positions.len()],
            ..Self::default()
        };
        let names = Names(settings);
        for constant in &settings.estimate {
            match *constant {
                Constant::LeverArm(sensor) => {
                    let arm = &settings.positions[sensor];
                    let first = all.unknowns.len();
                    for (axis, base) in ["x", "y", "z"].iter().zip(arm.lever_arm_m.iter()) {
                        let name = format!("{}.lever_arm.{axis}", arm.name);
                        all.add(name, "m", *base, PRIOR_LEVER_ARM_M);
                    }
                    all.positions[sensor].lever_arm = Some(first);
                }
                Constant::IncidenceBias(sensor) => {
                    let first = all.unknowns.len();
                    for direction in ["along", "across", "up"] {
                        for wave in ["cos", "sin"] {
                            let name = format!(
                                "{}.incidence_bias.{direction}_{wave}",
                                settings.positions[sensor].name
                            );
                            all.add(name, "m", 0.0, PRIOR_INCIDENCE_M);
                        }
                    }
                    all.positions[sensor].incidence = Some(first);
                }
                Constant::HeadingOffset => {
                    let base = settings.heading.mounting_offset_rad;
                    let name = "heading.mounting_offset".into();
                    all.heading_offset = Some(all.add(name, "rad", base, PRIOR_OFFSET_RAD));
                }
                Constant::Gravity => {
                    let base = settings.gravity_m_s2;
                    let name = "frame.gravity".into();
                    all.gravity = Some(all.add(name, "m/s²", base, PRIOR_GRAVITY_M_S2));
                }
                // Times stand among the corrections of clocks; the noise's scale is a variance,
                // found from the residuals.
                Constant::TimeOffset(_) | Constant::HeadingTimeOffset | Constant::ImuNoiseScale => {
                }
            }
        }
        for clock in corrections.iter().filter(|c| !c.held) {
            let sensor = names.sensor(clock.stream);
            let name = if clock.record == 0 {
                format!("{sensor}.time_offset")
            } else {
                format!("{sensor}.clock_jump at {:.3} s", clock.time_s)
            };
            let column = all.add(name, "s", clock.shift_s, PRIOR_TIME_S);
            all.late.push((clock.stream, clock.record, column));
        }
        all
    }

    /// With one more, the last: how late the records from a trace on are. For the IMU that is how
    /// late all others are from then on.
    pub fn with_jump(mut self, trace: &Trace, streams: &Streams) -> Self {
        let column = self.add("clock_jump".into(), "s", 0.0, PRIOR_TIME_S);
        if trace.stream != Stream::Imu {
            self.late.push((trace.stream, trace.record, column));
            return self;
        }
        for (sensor, fixes) in streams.positions.iter().enumerate() {
            let after = fixes.partition_point(|f| f.value.time_s < trace.time_s);
            if let Some(fix) = fixes.get(after) {
                self.late
                    .push((Stream::Position(sensor), fix.record, column));
            }
        }
        let after = streams
            .heading
            .partition_point(|h| h.value.time_s < trace.time_s);
        if let Some(fix) = streams.heading.get(after) {
            self.late.push((Stream::Heading, fix.record, column));
        }
        self
    }

    fn add(&mut self, name: String, unit: &'static str, base: f64, prior_sigma: f64) -> usize {
        self.unknowns.push(Unknown {
            name,
            unit,
            base,
            prior_sigma,
        });
        self.unknowns.len() - 1
    }

    pub fn count(&self) -> usize {
        self.unknowns.len()
    }

    pub fn gravity_m_s2(&self, values: &[f64]) -> f64 {
        self.base_gravity_m_s2 + self.gravity.map_or(0.0, |c| values[c])
    }

    /// The columns whose sum says how late a record is.
    pub fn late(&self, stream: Stream, record: usize) -> Vec<usize> {
        self.late
            .iter()
            .filter(|(of, from, _)| *of == stream && *from <= record)
            .map(|(_, _, column)| *column)
            .collect()
    }

    /// Whether a column is a time.
    pub fn is_time(&self, column: usize) -> bool {
        self.late.iter().any(|(_, _, of)| *of == column)
    }

    /// The columns of the clock corrections, in their order.
    pub fn clocks(&self) -> impl Iterator<Item = usize> + '_ {
        self.late.iter().map(|(_, _, column)| *column)
    }
}
