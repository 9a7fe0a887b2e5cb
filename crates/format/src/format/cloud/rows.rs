//! Reader of clouds with all values that the cloud writers can write.

use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::format::cloud::sink::{CloudClock, CloudGrid, CloudPoint, CloudShape};
use crate::format::detect::detect;
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::las::columns::{ExtraColumn, extra_columns};
use crate::format::las::file::LasFile;
use crate::format::las::record::unix_from_adjusted_gps_s;
use crate::format::read::{crs_wkt, read_cloud};
use crate::format::{ExtraDimension, ExtraKind};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// An open cloud with its times and intensities and, from LAS and LAZ, its extra dimensions. Other fields of LAS are
/// left out.
pub struct CloudRows {
    shape: CloudShape,
    points: Points,
}

enum Points {
    /// A file that is read point by point.
    Las(LasFile, Vec<ExtraColumn>),
    Memory(PointCloud),
}

impl CloudRows {
    /// Opens a LAS or LAZ file; files of other formats are read into memory.
    ///
    /// # Errors
    /// Those of [`read_cloud`].
    pub fn open(input: impl Into<Input>) -> Result<Self> {
        let input = &input.into();
        let wkt = crs_wkt(input)?;
        if detect(input)?.is_las() {
            return Self::of_las(input, wkt);
        }
        let cloud = read_cloud(input)?;
        let shape = CloudShape::of(&cloud, wkt);
        Ok(Self {
            shape,
            points: Points::Memory(cloud),
        })
    }

    fn of_las(input: &Input, wkt: Option<String>) -> Result<Self> {
        let file = LasFile::open(input)?;
        let header = file.header();
        let bounds = header.bounds();
        let length = usize::from(header.point_format().extra_bytes);
        let (mut dimensions, mut columns) = (Vec::new(), Vec::new());
        for (name, column) in extra_columns(&file) {
            // Dimensions without a name or a type, or outside the extra bytes, are left out.
            if column.fits(length) && !name.is_empty() {
                dimensions.push(ExtraDimension::new(&name, column.kind(), ""));
                columns.push(column);
            }
        }
        if header.number_of_points() == 0 {
            return Err(nothing_in(input.path(), "point"));
        }
        let transforms = header.transforms();
        let steps = [&transforms.x, &transforms.y, &transforms.z].map(|axis| axis.scale);
        let offset_m = Vec3::new(
            transforms.x.offset,
            transforms.y.offset,
            transforms.z.offset,
        );
        let is_even = steps.iter().all(|step| *step == steps[0]);
        let shape = CloudShape {
            grid: is_even.then_some(CloudGrid {
                offset_m,
                step_m: steps[0],
            }),
            low: Vec3::new(bounds.min.x, bounds.min.y, bounds.min.z),
            high: Vec3::new(bounds.max.x, bounds.max.y, bounds.max.z),
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
            points: Points::Las(file, columns),
        })
    }

    /// The shape of the cloud.
    pub fn shape(&self) -> &CloudShape {
        &self.shape
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

    /// Whether intensities are whole numbers from 0 to 65535, as LAS stores them.
    pub fn has_whole_intensities(&self) -> bool {
        match &self.points {
            Points::Memory(cloud) => {
                let is_whole = |v: &f32| v.fract() == 0.0 && (0.0..=65535.0).contains(v);
                cloud.intensity.iter().all(is_whole)
            }
            Points::Las(..) => true,
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
        let mut values = vec![0.0; columns.len()];
        let is_unix = self.shape.clock == CloudClock::Unix;
        loop {
            let count = file.read(CHUNK_POINTS, |_, point| {
                for (value, column) in values.iter_mut().zip(&columns) {
                    *value = column.value(point.extra);
                }
                each(&CloudPoint {
                    position: point.position,
                    time_s: if is_unix {
                        unix_from_adjusted_gps_s(point.time_s)
                    } else {
                        point.time_s
                    },
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

fn for_each_in_memory(
    cloud: &PointCloud,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&CloudPoint<'_>) -> Result<()>,
) -> Result<()> {
    for (at, position) in cloud.points.iter().enumerate() {
        each(&CloudPoint {
            position: *position,
            time_s: cloud.time_s.get(at).copied().unwrap_or(f64::NAN),
            intensity: cloud.intensity.get(at).copied().unwrap_or(0.0),
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
        } else {
            ExtraKind::F64
        }
    }
}
