//! Constants: held, or estimated along with the trajectory as unknowns of the border of the normal
//! equations.

use std::collections::BTreeMap;

use super::gyro_scale::GyroScale;
use super::lasting::{Lasting, Modes};
use super::logs::{ClockCorrection, Course, Stream, latency_of};
use super::settings::{Constant, TrajectorySettings};
use super::streams::Names;
use crate::adjustment::{BorderPrior, Columns, Parameter, Retract};
use crate::geometry::Vec3;
use nalgebra::SVector;

/// Standard deviations of the priors: how far the values of a project may be off.
const PRIOR_TIME_S: f64 = 1.0;
const PRIOR_LEVER_ARM_M: f64 = 1.0;
const PRIOR_INCIDENCE_M: f64 = 0.02;
const PRIOR_STEP_M: f64 = 10.0;
const PRIOR_OFFSET_RAD: f64 = 1.0;
const PRIOR_GRAVITY_M_S2: f64 = 0.1;
/// Datasheets of MEMS gyroscopes allow 1 to 3 %.
const PRIOR_GYRO_SCALE: f64 = 0.02;

/// Amplitudes of the error of a 360° prism: along the line of sight, across it and up, cos and sin
/// of each, metres.
pub type IncidenceAmplitudes = SVector<f64, 6>;

/// The constants of one prism or antenna.
#[derive(Debug, Clone)]
pub struct PositionConstants {
    /// Body frame.
    pub lever_arm_m: Parameter<Vec3>,
    /// Zero where prisms are taken to be perfect.
    pub incidence_m: Parameter<IncidenceAmplitudes>,
}

/// By how much records are late beyond the corrections already made.
#[derive(Debug, Clone)]
struct Clock {
    late_s: Parameter<f64>,
    /// The streams that are late, each with its first late record.
    from: Vec<(Stream, usize)>,
    course: Course,
}

/// A clock that applies to a record, and the share of its value by which the record is late.
#[derive(Debug, Clone, Copy)]
pub struct LateBy {
    pub clock: usize,
    pub share: f64,
}

/// One column of the border.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// As in the project, with the component: `prism.lever_arm.x`.
    pub name: String,
    pub unit: &'static str,
    /// What the estimated correction is added to: the project's value, or for times the
    /// correction already made.
    pub base: f64,
    /// Standard deviation of the prior about the project's value.
    pub prior_sigma: f64,
}

/// By how much the positions of a sensor are off from a record on.
#[derive(Debug, Clone)]
pub struct OffsetFrom {
    sensor: usize,
    record: usize,
    /// World.
    pub offset_m: Parameter<Vec3>,
}

/// All constants.
#[derive(Debug, Clone)]
pub struct Constants {
    pub gravity_m_s2: Parameter<f64>,
    /// Scale factor of the gyroscope.
    pub gyro_scale: GyroScale,
    /// Correction of the mounting offset.
    pub heading_offset_rad: Parameter<f64>,
    /// One for each position sensor.
    pub positions: Vec<PositionConstants>,
    steps: Vec<OffsetFrom>,
    clocks: Vec<Clock>,
    /// Lasting errors of position sensors (world, metres), by sensor.
    lasting_m: BTreeMap<usize, Lasting<Vec3>>,
    /// Lasting error of the heading, radians.
    lasting_rad: Option<Lasting<f64>>,
    /// Number of columns before those of the lasting errors, which come after those of the settings.
    before_lasting: Option<usize>,
    columns: Columns,
    /// Describes each estimated column.
    pub described: Vec<Column>,
}

impl Constants {
    /// The constants of the settings. Those that the settings name are estimated, and one for each
    /// correction of a clock that is not held.
    pub fn new(settings: &TrajectorySettings, corrections: &[ClockCorrection]) -> Self {
        let positions = settings.positions.iter().map(|sensor| PositionConstants {
            lever_arm_m: Parameter::held(sensor.lever_arm_m),
            incidence_m: Parameter::held(IncidenceAmplitudes::zeros()),
        });
        let mut all = Self {
            gravity_m_s2: Parameter::held(settings.gravity_m_s2),
            gyro_scale: GyroScale::none(),
            heading_offset_rad: Parameter::held(0.0),
            positions: positions.collect(),
            steps: Vec::new(),
            clocks: Vec::new(),
            lasting_m: BTreeMap::new(),
            lasting_rad: None,
            before_lasting: None,
            columns: Columns::default(),
            described: Vec::new(),
        };
        // Latencies are among the corrections.
        for constant in settings
            .estimate
            .iter()
            .filter(|c| latency_of(**c).is_none())
        {
            all.free(*constant, settings);
        }
        for clock in corrections.iter().filter(|c| !c.held) {
            all.correct(clock, settings);
        }
        all
    }

    /// Adds the columns of the lasting error of a position sensor with these standard deviations (world, metres),
    /// after those of the settings.
    pub fn add_lasting_position(&mut self, sensor: usize, sigma_m: Vec3, modes: Modes) {
        self.before_lasting.get_or_insert(self.columns.count);
        let axes = ["east", "north", "up"];
        for (mode, axis) in (0..modes.count()).flat_map(|mode| axes.map(|axis| (mode, axis))) {
            let name = format!("lasting error {mode} of positions {axis}");
            self.describe(name, "", 0.0, 1.0);
        }
        let lasting = Lasting::new(sigma_m, modes, Vec3::zeros(), &mut self.columns);
        self.lasting_m.insert(sensor, lasting);
    }

    /// The same for the heading, radians.
    pub fn add_lasting_heading(&mut self, sigma_rad: f64, modes: Modes) {
        self.before_lasting.get_or_insert(self.columns.count);
        for mode in 0..modes.count() {
            self.describe(format!("lasting error {mode} of headings"), "", 0.0, 1.0);
        }
        self.lasting_rad = Some(Lasting::new(sigma_rad, modes, 0.0, &mut self.columns));
    }

    /// The same without the lasting errors.
    pub fn without_lasting(mut self) -> Self {
        self.columns.count = self.before_lasting();
        self.described.truncate(self.columns.count);
        self.lasting_m.clear();
        self.lasting_rad = None;
        self.before_lasting = None;
        self
    }

    /// Number of columns before those of the lasting errors.
    pub fn before_lasting(&self) -> usize {
        self.before_lasting.unwrap_or(self.columns.count)
    }

    /// The amplitudes of the lasting error of a position at a time, each with its derivatives by axis, metres.
    pub fn lasting_position(
        &self,
        sensor: usize,
        time_s: f64,
    ) -> impl Iterator<Item = (&Parameter<Vec3>, Vec3)> {
        let lasting = self.lasting_m.get(&sensor).into_iter();
        lasting.flat_map(move |lasting| lasting.at(time_s))
    }

    /// The lasting error of a position at a time, metres.
    pub fn lasting_m(&self, sensor: usize, time_s: f64) -> Vec3 {
        let amplitudes = self.lasting_position(sensor, time_s);
        amplitudes.map(|(x, by)| x.value.component_mul(&by)).sum()
    }

    /// By how much the standard deviations of a position sensor are larger because of lasting errors that are taken for
    /// noise.
    pub fn position_noise(&self, sensor: usize) -> f64 {
        let lasting = self.lasting_m.get(&sensor);
        lasting.map_or(1.0, Lasting::noise_factor)
    }

    /// The same of the heading.
    pub fn heading_noise(&self) -> f64 {
        self.lasting_rad.as_ref().map_or(1.0, Lasting::noise_factor)
    }

    /// The amplitudes of the lasting error of the heading at a time, each with its derivative, radians.
    pub fn lasting_heading(&self, time_s: f64) -> impl Iterator<Item = (&Parameter<f64>, f64)> {
        let lasting = self.lasting_rad.iter();
        lasting.flat_map(move |lasting| lasting.at(time_s))
    }

    /// The lasting error of the heading at a time, radians.
    pub fn lasting_rad(&self, time_s: f64) -> f64 {
        let amplitudes = self.lasting_heading(time_s);
        amplitudes.map(|(x, by)| x.value * by).sum()
    }

    /// Adds the column of a correction of a clock.
    pub fn correct(&mut self, clock: &ClockCorrection, settings: &TrajectorySettings) {
        let sensor = Names(settings).sensor(clock.stream);
        let name = match (clock.record, clock.course) {
            (0, Course::Constant) => format!("{sensor}.time_offset"),
            (0, Course::Linear { .. }) => format!("{sensor}.time_drift"),
            _ => format!("{sensor}.clock_jump at {:.3} s", clock.time_s),
        };
        let from = vec![(clock.stream, clock.record)];
        self.add_clock(name, clock.shift_s, from, clock.course);
    }

    /// Adds the columns of one more constant; the noise scale has none, and those of times are added by
    /// [`Self::correct`].
    pub fn free(&mut self, constant: Constant, settings: &TrajectorySettings) {
        match constant {
            Constant::LeverArm(sensor) => {
                let arm = &settings.positions[sensor];
                let parameter = &mut self.positions[sensor].lever_arm_m;
                parameter.estimate(&mut self.columns);
                for (axis, base) in ["x", "y", "z"].iter().zip(arm.lever_arm_m.iter()) {
                    let name = format!("{}.lever_arm.{axis}", arm.name);
                    self.describe(name, "m", *base, PRIOR_LEVER_ARM_M);
                }
            }
            Constant::IncidenceBias(sensor) => {
                let parameter = &mut self.positions[sensor].incidence_m;
                parameter.estimate(&mut self.columns);
                let sensor = &settings.positions[sensor].name;
                for direction in ["along", "across", "up"] {
                    for wave in ["cos", "sin"] {
                        let name = format!("{sensor}.incidence_bias.{direction}_{wave}");
                        self.describe(name, "m", 0.0, PRIOR_INCIDENCE_M);
                    }
                }
            }
            Constant::PositionStep { sensor, record } => {
                let mut offset_m = Parameter::held(Vec3::zeros());
                offset_m.estimate(&mut self.columns);
                self.steps.push(OffsetFrom {
                    sensor,
                    record,
                    offset_m,
                });
                for axis in ["east", "north", "up"] {
                    let name = format!("{}.{axis}", constant.name(&settings.positions));
                    self.describe(name, "m", 0.0, PRIOR_STEP_M);
                }
            }
            Constant::HeadingOffset => {
                let base = settings.heading.mounting_offset_rad;
                self.heading_offset_rad.estimate(&mut self.columns);
                self.describe(
                    "heading.mounting_offset".into(),
                    "rad",
                    base,
                    PRIOR_OFFSET_RAD,
                );
            }
            Constant::Gravity => {
                let base = settings.gravity_m_s2;
                self.gravity_m_s2.estimate(&mut self.columns);
                self.describe("frame.gravity".into(), "m/s²", base, PRIOR_GRAVITY_M_S2);
            }
            Constant::GyroScale => {
                self.gyro_scale.factor.estimate(&mut self.columns);
                for axis in ["x", "y", "z"] {
                    let name = format!("{}.{axis}", constant.name(&settings.positions));
                    self.describe(name, "", 1.0, PRIOR_GYRO_SCALE);
                }
            }
            // Corrections of clocks, and a variance component, which is estimated from the residuals.
            Constant::TimeOffset(_)
            | Constant::TimeDrift(_)
            | Constant::HeadingTimeOffset
            | Constant::ImuNoiseScale => {}
        }
    }

    /// Adds one more constant, the last: how late the records of these streams are, each from this record
    /// on.
    pub fn add_jump(&mut self, from: Vec<(Stream, usize)>) {
        self.add_clock("clock_jump".into(), 0.0, from, Course::Constant);
    }

    fn add_clock(&mut self, name: String, base: f64, from: Vec<(Stream, usize)>, course: Course) {
        let mut late_s = Parameter::held(0.0);
        late_s.estimate(&mut self.columns);
        self.clocks.push(Clock {
            late_s,
            from,
            course,
        });
        self.describe(name, "s", base, PRIOR_TIME_S);
    }

    fn describe(&mut self, name: String, unit: &'static str, base: f64, prior_sigma: f64) {
        self.described.push(Column {
            name,
            unit,
            base,
            prior_sigma,
        });
    }

    /// Number of columns of the border.
    pub fn count(&self) -> usize {
        self.columns.count
    }

    /// Takes over the values of an earlier adjustment, except those of its clocks, which have become
    /// corrections.
    pub fn resume(&mut self, before: &Self) {
        self.gravity_m_s2.value = before.gravity_m_s2.value;
        self.gyro_scale.resume(&before.gyro_scale);
        self.heading_offset_rad.value = before.heading_offset_rad.value;
        for (sensor, before) in self.positions.iter_mut().zip(&before.positions) {
            sensor.lever_arm_m.value = before.lever_arm_m.value;
            sensor.incidence_m.value = before.incidence_m.value;
        }
        for (step, before) in self.steps.iter_mut().zip(&before.steps) {
            step.offset_m.value = before.offset_m.value;
        }
        let positions = self.lasting_m.values_mut();
        for (lasting, before) in positions.zip(before.lasting_m.values()) {
            lasting.resume(before);
        }
        if let (Some(lasting), Some(before)) = (&mut self.lasting_rad, &before.lasting_rad) {
            lasting.resume(before);
        }
    }

    /// The offsets of a position.
    pub fn steps_before(&self, sensor: usize, record: usize) -> impl Iterator<Item = &OffsetFrom> {
        let steps = self.steps.iter();
        steps.filter(move |step| step.sensor == sensor && step.record <= record)
    }

    /// The clocks that apply to a record at this time.
    pub fn clocks_of(&self, stream: Stream, record: usize, time_s: f64) -> Vec<LateBy> {
        let applies = |clock: &Clock| {
            let mut from = clock.from.iter();
            from.any(|(late, first)| *late == stream && *first <= record)
        };
        (0..self.clocks.len())
            .filter(|&clock| applies(&self.clocks[clock]))
            .map(|clock| LateBy {
                clock,
                share: self.clocks[clock].course.share(time_s),
            })
            .collect()
    }

    /// How late a record is to which these clocks apply, seconds.
    pub fn late_s(&self, clocks: &[LateBy]) -> f64 {
        let late_s = |by: &LateBy| by.share * self.clocks[by.clock].late_s.value;
        clocks.iter().map(late_s).sum()
    }

    /// How late each clock is, seconds, in the order of the corrections that are not held.
    pub fn clocks(&self) -> impl Iterator<Item = &Parameter<f64>> + Clone {
        self.clocks.iter().map(|clock| &clock.late_s)
    }

    /// How late one clock is, seconds.
    pub fn clock(&self, clock: usize) -> &Parameter<f64> {
        &self.clocks[clock].late_s
    }

    fn all(&self) -> impl Iterator<Item = &dyn Retract> {
        let shared: [&dyn Retract; 3] = [
            &self.gravity_m_s2,
            &self.gyro_scale.factor,
            &self.heading_offset_rad,
        ];
        let positions = self
            .positions
            .iter()
            .flat_map(|sensor| [&sensor.lever_arm_m as &dyn Retract, &sensor.incidence_m]);
        let steps = self.steps.iter().map(|step| &step.offset_m as &dyn Retract);
        let clocks = self.clocks.iter().map(|c| &c.late_s as &dyn Retract);
        let lasting_m = self.lasting_m.values().flat_map(|l| &l.amplitudes);
        let lasting_rad = self.lasting_rad.iter().flat_map(|l| &l.amplitudes);
        shared
            .into_iter()
            .chain(positions)
            .chain(steps)
            .chain(clocks)
            .chain(lasting_m.map(|x| x as &dyn Retract))
            .chain(lasting_rad.map(|x| x as &dyn Retract))
    }

    fn all_mut(&mut self) -> impl Iterator<Item = &mut dyn Retract> {
        let shared: [&mut dyn Retract; 3] = [
            &mut self.gravity_m_s2,
            &mut self.gyro_scale.factor,
            &mut self.heading_offset_rad,
        ];
        let positions = self.positions.iter_mut().flat_map(|sensor| {
            [
                &mut sensor.lever_arm_m as &mut dyn Retract,
                &mut sensor.incidence_m,
            ]
        });
        let clocks = self.clocks.iter_mut();
        let clocks = clocks.map(|c| &mut c.late_s as &mut dyn Retract);
        let steps = self.steps.iter_mut();
        let steps = steps.map(|step| &mut step.offset_m as &mut dyn Retract);
        let lasting_m = self.lasting_m.values_mut().flat_map(|l| &mut l.amplitudes);
        let lasting_rad = self.lasting_rad.iter_mut();
        let lasting_rad = lasting_rad.flat_map(|l| &mut l.amplitudes);
        shared
            .into_iter()
            .chain(positions)
            .chain(steps)
            .chain(clocks)
            .chain(lasting_m.map(|x| x as &mut dyn Retract))
            .chain(lasting_rad.map(|x| x as &mut dyn Retract))
    }

    /// The constants after a step of all columns.
    pub fn retracted(&self, step: &[f64]) -> Self {
        let mut moved = self.clone();
        moved
            .all_mut()
            .for_each(|parameter| parameter.retract(step));
        moved
    }

    /// How far each column is from where it started.
    pub fn corrections(&self) -> Vec<f64> {
        let mut step = vec![0.0; self.count()];
        self.all()
            .for_each(|parameter| parameter.correction(&mut step));
        step
    }

    /// The priors about the project's values.
    pub fn prior(&self) -> BorderPrior {
        BorderPrior {
            weight: self
                .described
                .iter()
                .map(|c| c.prior_sigma.powi(-2))
                .collect(),
            miss: self.corrections(),
        }
    }
}
