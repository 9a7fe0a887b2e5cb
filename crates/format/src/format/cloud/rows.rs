//! Reader of clouds with all values that the cloud writers can write.

use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};

use crate::format::cloud::sink::{CloudClock, CloudGrid, CloudPoint, CloudShape};
use crate::format::detect::detect;
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::las::columns::{ExtraColumn, ExtraEntry, extra_columns, extra_entries};
use crate::format::las::file::LasFile;
use crate::format::las::value::ExtraValue;
use crate::format::read::{crs_wkt, read_cloud};
use crate::format::{ExtraDimension, ExtraKind};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// An open cloud with its times and intensities and, from LAS and LAZ, its extra dimensions. Other fields of LAS are
/// left out.
pub struct CloudRows {
    shape: CloudShape,
    points: Points,
    remarks: Vec<String>,
}

enum Points {
    /// A file that is read point by point.
    Las(Box<LasFile>, Vec<ExtraColumn>),
    Memory(PointCloud),
}

impl CloudRows {
    /// Opens a LAS or LAZ file; files of other formats are read into memory. Coordinates in feet are converted to metres.
    ///
    /// # Errors
    /// Those of [`read_cloud`].
    pub fn open(input: impl Into<Input>) -> Result<Self> {
        let input = &input.into();
        let wkt = crs_wkt(input)?;
        if detect(input)?.is_las() {
            return Self::of_las(LasFile::open(input)?, wkt);
        }
        let cloud = read_cloud(input)?;
        let shape = CloudShape::of(&cloud, wkt);
        Ok(Self {
            shape,
            points: Points::Memory(cloud),
            remarks: input.remarks(),
        })
    }

    /// Opens a LAS or LAZ file whose coordinates stay in their unit, that of its coordinate system.
    ///
    /// # Errors
    /// Those of [`read_cloud`].
    pub fn open_in_unit_of_file(input: impl Into<Input>) -> Result<Self> {
        let input = &input.into();
        let mut file = LasFile::open(input)?;
        file.keep_unit();
        Self::of_las(file, crs_wkt(input)?)
    }

    fn of_las(file: LasFile, wkt: Option<String>) -> Result<Self> {
        let header = file.header();
        let bounds = header.bounds();
        let mut remarks = file.remarks();
        let metres = file.converted().map(|(_, metres)| metres);
        if metres.is_some() && wkt.is_some() {
            remarks.push("the coordinate system, which has another unit, is left out".to_owned());
        }
        let wkt = wkt.filter(|_| metres.is_none());
        let metres = metres.unwrap_or(Vec3::repeat(1.0));
        let (mut dimensions, mut columns) = (Vec::<ExtraDimension>::new(), Vec::new());
        for (name, column) in extra_columns(&file) {
            let name = if name.is_empty() { "unnamed" } else { &name };
            let distinct = distinct(name, &dimensions);
            if distinct != name {
                remarks.push(format!(
                    "the extra dimension `{name}` has the name of another value: it is called `{distinct}`"
                ));
            }
            dimensions.push(ExtraDimension::new(&distinct, column.kind(), ""));
            columns.push(column);
        }
        remarks.extend(left_out(&file));
        if header.number_of_points() == 0 {
            return Err(nothing_in(file.path(), "point"));
        }
        let transforms = header.transforms();
        let scales = [&transforms.x, &transforms.y, &transforms.z].map(|axis| axis.scale);
        let steps = Vec3::from(scales).component_mul(&metres);
        let offset_m = Vec3::new(
            transforms.x.offset,
            transforms.y.offset,
            transforms.z.offset,
        )
        .component_mul(&metres);
        let is_even = steps.iter().all(|step| *step == steps[0]);
        let shape = CloudShape {
            median: None,
            grid: is_even.then_some(CloudGrid {
                offset_m,
                step_m: steps[0],
            }),
            low: Vec3::new(bounds.min.x, bounds.min.y, bounds.min.z).component_mul(&metres),
            high: Vec3::new(bounds.max.x, bounds.max.y, bounds.max.z).component_mul(&metres),
            has_time: file.has_time(),
            // Adjusted standard GPS time is converted to Unix time, like all other absolute times.
            clock: match header.gps_time_type() {
                las::GpsTimeType::Standard => CloudClock::Unix,
                las::GpsTimeType::Week => CloudClock::GpsWeek,
            },
            has_intensity: true,
            dimensions,
            wkt,
        };
        Ok(Self {
            shape,
            points: Points::Las(Box::new(file), columns),
            remarks,
        })
    }

    /// The shape of the cloud.
    pub fn shape(&self) -> &CloudShape {
        &self.shape
    }

    /// What is left out of the file, renamed or assumed, one sentence each.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// Those of the remarks that also hold for a copy with all fields of LAS.
    pub fn remarks_on_header(&self) -> Vec<String> {
        match &self.points {
            Points::Las(file, _) => file.remarks(),
            Points::Memory(_) => Vec::new(),
        }
    }

    /// Number of points.
    #[expect(clippy::len_without_is_empty, reason = "no cloud is empty")]
    pub fn len(&self) -> u64 {
        match &self.points {
            Points::Las(file, _) => file.header().number_of_points(),
            Points::Memory(cloud) => cloud.points.len() as u64,
        }
    }

    /// Names of the fields of LAS that are left out; empty for other formats.
    pub fn left_out(&self) -> &'static str {
        match &self.points {
            Points::Memory(_) => "",
            Points::Las(file, _) if file.header().point_format().has_color => {
                "classes, returns, scan angles, flags and colours"
            }
            Points::Las(..) => "classes, returns, scan angles and flags",
        }
    }

    /// Calls `each` with every point in order. `progress` advances by one for each point; the caller begins and
    /// ends the stage.
    ///
    /// # Errors
    /// A file that is damaged or ends early; errors of `each`.
    pub fn for_each(
        self,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&CloudPoint<'_>) -> Result<()>,
    ) -> Result<()> {
        let expected = self.len();
        let (mut file, columns) = match self.points {
            Points::Las(file, columns) => (file, columns),
            Points::Memory(cloud) => return for_each_in_memory(&cloud, progress, each),
        };
        let mut values = vec![ExtraValue::NONE; columns.len()];
        loop {
            let count = file.read(CHUNK_POINTS, |_, point| {
                for (value, column) in values.iter_mut().zip(&columns) {
                    *value = column.value(point.extra);
                }
                each(&CloudPoint {
                    position: point.position,
                    time_s: point.time_s,
                    intensity: point.intensity,
                    values: &values,
                })
            })?;
            if count == 0 {
                break;
            }
            progress.advance(count);
            progress.check()?;
        }
        if file.taken() == expected {
            return Ok(());
        }
        Err(Error::format(
            file.path(),
            Location::Whole,
            format!("{} points", file.taken()),
            format!("the {expected} points of its header"),
        ))
    }
}

/// Names of the values that points of all formats have, in lower case.
const STANDARD: [&str; 8] = [
    "x",
    "y",
    "z",
    "east_m",
    "north_m",
    "up_m",
    "time_s",
    "intensity",
];

/// A name that differs from those of the standard values and of the other dimensions: a number is put behind it.
fn distinct(name: &str, others: &[ExtraDimension]) -> String {
    let is_taken = |name: &str| {
        let mut taken = others
            .iter()
            .map(|other| other.name.as_str())
            .chain(STANDARD);
        taken.any(|other| other.eq_ignore_ascii_case(name))
    };
    let mut numbered = (2..).map(|number| format!("{name}_{number}"));
    if is_taken(name) {
        numbered.find(|name| !is_taken(name)).unwrap_or_default()
    } else {
        name.to_owned()
    }
}

/// What is left out of the extra bytes of a file.
fn left_out(file: &LasFile) -> Option<String> {
    let length = usize::from(file.header().point_format().extra_bytes);
    let entries = extra_entries(file);
    let is_without = |entry: &&ExtraEntry<'_>| entry.columns(length).is_empty();
    let names: Vec<String> = entries
        .iter()
        .filter(is_without)
        .map(|entry| format!("`{}`", entry.name))
        .collect();
    let described: usize = entries.iter().map(|entry| entry.size).sum();
    match (names.is_empty(), length.saturating_sub(described)) {
        (true, 0) => None,
        (true, bytes) => Some(format!(
            "{bytes} extra bytes of each point are not described and left out"
        )),
        (false, _) => Some(format!(
            "the extra dimensions {} have no type or no place in the points: they are left out",
            names.join(", ")
        )),
    }
}

fn for_each_in_memory(
    cloud: &PointCloud,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&CloudPoint<'_>) -> Result<()>,
) -> Result<()> {
    for (at, position) in cloud.points.iter().enumerate() {
        each(&CloudPoint {
            position: *position,
            time_s: cloud.time_s.get(at).copied().unwrap_or(f64::NAN),
            intensity: cloud.intensity.get(at).copied().unwrap_or(f32::NAN),
            values: &[],
        })?;
        if at % 65_536 == 65_535 {
            progress.advance(65_536);
            progress.check()?;
        }
    }
    progress.advance(cloud.points.len() as u64 % 65_536);
    Ok(())
}

impl ExtraColumn {
    /// The type in which the values of the column are written.
    fn kind(&self) -> ExtraKind {
        if self.is_small_count() {
            ExtraKind::U32
        } else if self.is_u64() {
            ExtraKind::U64
        } else if self.is_i64() {
            ExtraKind::I64
        } else {
            ExtraKind::F64
        }
    }
}
