//! A cloud file that is read more than once.

use std::borrow::Cow;
use std::path::Path;

use super::stage::stage;
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::{self, ExtraDimension, Format, Input, Row};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Number of points passed on at a time from a cloud in memory.
const CHUNK: usize = 100_000;

/// The points of a cloud: LAS and LAZ remain in their file, which is streamed as often as needed;
/// clouds of other formats are kept in memory.
#[derive(Debug)]
pub enum CloudSource {
    /// A LAS or LAZ file.
    Las {
        /// The file.
        input: Input,
        /// Number of points, from its header.
        points: u64,
    },
    /// The content of a file of another format.
    Memory {
        /// Its points.
        cloud: PointCloud,
        /// Its coordinate reference system.
        wkt: Option<String>,
        /// The places from which its points were seen, metres; empty if the file does not tell.
        viewpoints_m: Vec<Vec3>,
    },
}

impl CloudSource {
    /// Reads the header of a LAS or LAZ file, or the whole of any other.
    ///
    /// # Errors
    /// As [`format::las_count`], [`format::las_remarks`] and [`format::read_cloud`].
    pub fn open(input: impl Into<Input>, progress: &dyn Progress) -> Result<Self> {
        let input = &input.into();
        let path = input.path();
        // For a file of unknown format, the reader gives the better error.
        if format::detect(input).is_ok_and(Format::is_las) {
            for remark in format::las_remarks(input)? {
                progress.warn(&format!("{}: {remark}", path.display()));
            }
            return Ok(Self::Las {
                input: input.clone(),
                points: format::las_count(input)?,
            });
        }
        let read = || format::read_cloud(input);
        let (cloud, _) = stage(progress, "reading the cloud", 0, read)?;
        for remark in input.remarks() {
            progress.warn(&format!("{}: {remark}", path.display()));
        }
        let wkt = format::crs_wkt(input)?;
        Ok(Self::Memory {
            cloud,
            wkt,
            viewpoints_m: input.viewpoints_m(),
        })
    }

    /// The places from which its points were seen, metres; empty if the file does not tell.
    ///
    /// # Errors
    /// A file that is damaged or ends early.
    pub fn viewpoints_m(&self) -> Result<Vec<Vec3>> {
        match self {
            Self::Las { input, .. } => format::las_viewpoints(input),
            Self::Memory { viewpoints_m, .. } => Ok(viewpoints_m.clone()),
        }
    }

    /// Number of points; at least one.
    #[expect(clippy::len_without_is_empty, reason = "no cloud is empty")]
    pub fn len(&self) -> u64 {
        match self {
            Self::Las { points, .. } => *points,
            Self::Memory { cloud, .. } => cloud.points.len() as u64,
        }
    }

    /// Calls `each` with the points (metres) in pieces and in order. `progress` advances by one for
    /// each point; the caller begins and ends the stage.
    ///
    /// # Errors
    /// A file that is damaged or ends early; errors of `each`.
    pub fn stream(
        &self,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&[Vec3]) -> Result<()>,
    ) -> Result<()> {
        let mut each = |points: &[Vec3]| {
            each(points)?;
            progress.advance(points.len() as u64);
            progress.check()
        };
        match self {
            Self::Las { input, .. } => format::stream_las(input, &mut each),
            Self::Memory { cloud, .. } => cloud.points.chunks(CHUNK).try_for_each(each),
        }
    }

    /// All points at once, metres.
    ///
    /// # Errors
    /// As [`Self::stream`].
    pub fn points(&self, progress: &dyn Progress) -> Result<Cow<'_, [Vec3]>> {
        if let Self::Memory { cloud, .. } = self {
            return Ok(Cow::Borrowed(&cloud.points));
        }
        let mut points = Vec::with_capacity(self.len() as usize);
        stage(progress, "reading the cloud", self.len(), || {
            self.stream(progress, &mut |piece| {
                points.extend_from_slice(piece);
                Ok(())
            })
        })?;
        Ok(Cow::Owned(points))
    }

    /// Writes the points that `row` accepts to `output`, with all fields of LAS and LAZ or with the
    /// time and intensity of other formats, and with `dimensions`; returns the time taken in
    /// seconds.
    ///
    /// # Errors
    /// As [`format::copy_las`] and [`format::cloud_to_las`].
    pub fn write(
        &self,
        output: &Path,
        dimensions: &[ExtraDimension],
        row: &mut Row<'_>,
        progress: &dyn Progress,
    ) -> Result<f64> {
        let write = || match self {
            Self::Las { input, .. } => format::copy_las(input, output, dimensions, row, progress),
            Self::Memory { cloud, wkt, .. } => {
                format::cloud_to_las(cloud, output, dimensions, wkt.clone(), row, progress)
            }
        };
        stage(progress, "writing the cloud", self.len(), write).map(|(_, seconds)| seconds)
    }
}
