//! Between numpy's arrays and the library's records.
//!
//! A log goes as an array of n × w numbers, of which the Python files make structured arrays: the order of the
//! columns is that of the types in `package/boresight/logs.py`. What a record does not have is NaN.

use boresight::geometry::{Mat3, Rotation, Vec3, WorldFromBody};
use boresight::sensor::{
    HeadingFix, ImuBias, ImuSample, PoseRecord, PoseSigma, PositionFix, ScanPoint,
};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Columns of a trajectory.
pub(crate) const POSE: usize = 23;
/// Columns of an IMU log.
pub(crate) const IMU: usize = 7;
/// Columns of a position log.
pub(crate) const POSITION: usize = 13;
/// Columns of a heading log.
pub(crate) const HEADING: usize = 5;
/// Columns of profiles.
pub(crate) const PROFILE: usize = 5;

/// The rows of an array of n × `N` numbers, without a copy.
pub(crate) fn rows<'a, const N: usize>(
    array: &'a PyReadonlyArray2<'_, f64>,
) -> PyResult<&'a [[f64; N]]> {
    if array.shape()[1] != N || !array.is_c_contiguous() {
        let shape = array.shape();
        return Err(PyValueError::new_err(format!(
            "an array of shape {shape:?}, expected (n, {N}) in one piece"
        )));
    }
    Ok(array.as_slice()?.as_chunks().0)
}

/// The rows of an array of n × 3 numbers, without a copy.
pub(crate) fn vectors<'a>(array: &'a PyReadonlyArray2<'_, f64>) -> PyResult<&'a [Vec3]> {
    Ok(bytemuck::cast_slice(rows::<3>(array)?))
}

/// The numbers of an array, without a copy.
pub(crate) fn numbers<'a>(array: &'a PyReadonlyArray1<'_, f64>) -> PyResult<&'a [f64]> {
    Ok(array.as_slice()?)
}

/// An array of n × 3 numbers, without a copy.
pub(crate) fn from_vectors(py: Python<'_>, vectors: Vec<Vec3>) -> PyResult<Array2<'_>> {
    let shape = [vectors.len(), 3];
    PyArray1::from_vec(py, bytemuck::cast_vec::<Vec3, f64>(vectors)).reshape(shape)
}

/// An array of n × `N` numbers, without a copy.
pub(crate) fn from_rows<const N: usize>(
    py: Python<'_>,
    rows: Vec<[f64; N]>,
) -> PyResult<Array2<'_>> {
    let shape = [rows.len(), N];
    PyArray1::from_vec(py, rows.into_flattened()).reshape(shape)
}

/// An array of n × m numbers.
pub(crate) type Array2<'py> = Bound<'py, PyArray2<f64>>;

/// A record as a row of numbers.
pub(crate) trait Record<const N: usize>: Sized {
    fn to_row(&self) -> [f64; N];
    fn of_row(row: &[f64; N]) -> Self;
}

/// Records as an array.
pub(crate) fn from_records<'py, const N: usize, T: Record<N>>(
    py: Python<'py>,
    records: &[T],
) -> PyResult<Array2<'py>> {
    from_rows(py, records.iter().map(T::to_row).collect())
}

/// An array as records.
pub(crate) fn records<const N: usize, T: Record<N>>(
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<T>> {
    Ok(rows::<N>(array)?.iter().map(T::of_row).collect())
}

/// A row put together from pieces.
struct Row<const N: usize> {
    values: [f64; N],
    length: usize,
}

impl<const N: usize> Row<N> {
    fn new() -> Self {
        Self {
            values: [f64::NAN; N],
            length: 0,
        }
    }

    fn with(mut self, piece: &[f64]) -> Self {
        self.values[self.length..][..piece.len()].copy_from_slice(piece);
        self.length += piece.len();
        self
    }

    /// A piece that may be unknown.
    fn with_any(self, piece: Option<Vec3>) -> Self {
        self.with(piece.unwrap_or(Vec3::repeat(f64::NAN)).as_slice())
    }
}

fn vector(row: &[f64], at: usize) -> Vec3 {
    Vec3::new(row[at], row[at + 1], row[at + 2])
}

fn known(value: f64) -> Option<f64> {
    (!value.is_nan()).then_some(value)
}

fn known_vector(row: &[f64], at: usize) -> Option<Vec3> {
    let vector = vector(row, at);
    (!vector.iter().any(|value| value.is_nan())).then_some(vector)
}

impl Record<POSE> for PoseRecord {
    fn to_row(&self) -> [f64; POSE] {
        let pose = &self.world_from_body;
        Row::new()
            .with(&[self.time_s])
            .with(pose.translation_m.as_slice())
            .with(pose.rotation.coords.as_slice())
            .with_any(self.velocity_m_s)
            .with_any(self.bias.map(|bias| bias.gyro_rad_s))
            .with_any(self.bias.map(|bias| bias.accel_m_s2))
            .with_any(self.sigma.map(|sigma| sigma.position_m))
            .with_any(self.sigma.map(|sigma| sigma.rotation_rad))
            .values
    }

    fn of_row(row: &[f64; POSE]) -> Self {
        let both = |a, b| Some((known_vector(row, a)?, known_vector(row, b)?));
        Self {
            time_s: row[0],
            world_from_body: WorldFromBody::new(
                quaternion([row[4], row[5], row[6], row[7]]),
                vector(row, 1),
            ),
            velocity_m_s: known_vector(row, 8),
            bias: both(11, 14).map(|(gyro_rad_s, accel_m_s2)| ImuBias {
                gyro_rad_s,
                accel_m_s2,
            }),
            sigma: both(17, 20).map(|(position_m, rotation_rad)| PoseSigma {
                position_m,
                rotation_rad,
            }),
        }
    }
}

/// The rotation of a unit quaternion x, y, z, w. One that is normalised to the last digits is taken as it is, so
/// that poses survive the way through Python bit by bit.
pub(crate) fn quaternion([x, y, z, w]: [f64; 4]) -> Rotation {
    let given = nalgebra::Quaternion::new(w, x, y, z);
    if (given.norm_squared() - 1.0).abs() < 1e-14 {
        Rotation::new_unchecked(given)
    } else {
        Rotation::from_quaternion(given)
    }
}

impl Record<IMU> for ImuSample {
    fn to_row(&self) -> [f64; IMU] {
        Row::new()
            .with(&[self.time_s])
            .with(self.gyro_rad_s.as_slice())
            .with(self.accel_m_s2.as_slice())
            .values
    }

    fn of_row(row: &[f64; IMU]) -> Self {
        Self {
            time_s: row[0],
            gyro_rad_s: vector(row, 1),
            accel_m_s2: vector(row, 4),
        }
    }
}

impl Record<POSITION> for PositionFix {
    fn to_row(&self) -> [f64; POSITION] {
        let unknown = Mat3::repeat(f64::NAN);
        Row::new()
            .with(&[self.time_s])
            .with(self.position_m.as_slice())
            .with(self.covariance_m2.unwrap_or(unknown).as_slice())
            .values
    }

    fn of_row(row: &[f64; POSITION]) -> Self {
        let covariance = Mat3::from_column_slice(&row[4..]);
        let is_known = !covariance.iter().any(|value| value.is_nan());
        Self {
            time_s: row[0],
            position_m: vector(row, 1),
            covariance_m2: is_known.then_some(covariance),
        }
    }
}

impl Record<HEADING> for HeadingFix {
    fn to_row(&self) -> [f64; HEADING] {
        let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
        [
            self.time_s,
            self.heading_rad,
            or_nan(self.sigma_rad),
            or_nan(self.pitch_rad),
            or_nan(self.pitch_sigma_rad),
        ]
    }

    fn of_row(row: &[f64; HEADING]) -> Self {
        Self {
            time_s: row[0],
            heading_rad: row[1],
            sigma_rad: known(row[2]),
            pitch_rad: known(row[3]),
            pitch_sigma_rad: known(row[4]),
        }
    }
}

impl Record<PROFILE> for ScanPoint {
    fn to_row(&self) -> [f64; PROFILE] {
        Row::new()
            .with(&[self.time_s])
            .with(self.position_m.as_slice())
            .with(&[f64::from(self.intensity)])
            .values
    }

    fn of_row(row: &[f64; PROFILE]) -> Self {
        Self {
            time_s: row[0],
            position_m: vector(row, 1),
            intensity: row[4] as f32,
        }
    }
}
