//! Unknowns with their retraction, and the columns of unknowns outside the chain.

use crate::geometry::{BodyFromScanner, Vec3, WorldFromBody};
use nalgebra::SVector;
use std::fmt;
use std::marker::PhantomData;
use std::ops::Range;

/// A value that the adjustment estimates, and how a step moves it.
pub trait Unknown: Clone {
    /// Number of parameters of a step.
    const DIMENSION: usize;

    /// The value after a step of [`Unknown::DIMENSION`] parameters.
    fn retracted(&self, step: &[f64]) -> Self;

    /// The step that leads from `origin` to this value: the inverse of [`Unknown::retracted`].
    fn step_from(&self, origin: &Self, step: &mut [f64]);
}

impl Unknown for f64 {
    const DIMENSION: usize = 1;

    fn retracted(&self, step: &[f64]) -> Self {
        self + step[0]
    }

    fn step_from(&self, origin: &Self, step: &mut [f64]) {
        step[0] = self - origin;
    }
}

impl<const N: usize> Unknown for SVector<f64, N> {
    const DIMENSION: usize = N;

    fn retracted(&self, step: &[f64]) -> Self {
        self + Self::from_column_slice(step)
    }

    fn step_from(&self, origin: &Self, step: &mut [f64]) {
        step.copy_from_slice((self - origin).as_slice());
    }
}

/// The first three parameters and the other three.
fn halves(step: &[f64]) -> (Vec3, Vec3) {
    let half = |at: usize| Vec3::from_column_slice(&step[at..at + 3]);
    (half(0), half(3))
}

/// Steps are (δφ, δp) as defined by [`Transform`](crate::geometry::Transform#perturbations).
impl Unknown for WorldFromBody {
    const DIMENSION: usize = 6;

    fn retracted(&self, step: &[f64]) -> Self {
        let (dphi_rad, dp_m) = halves(step);
        self.perturbed(&dphi_rad, &dp_m)
    }

    fn step_from(&self, origin: &Self, step: &mut [f64]) {
        let (dphi_rad, dp_m) = self.perturbation_from(origin);
        step[..3].copy_from_slice(dphi_rad.as_slice());
        step[3..].copy_from_slice(dp_m.as_slice());
    }
}

/// Steps are (δφ, δp) as defined by [`Transform`](crate::geometry::Transform#perturbations).
impl Unknown for BodyFromScanner {
    const DIMENSION: usize = 6;

    fn retracted(&self, step: &[f64]) -> Self {
        let (dphi_rad, dp_m) = halves(step);
        self.perturbed(&dphi_rad, &dp_m)
    }

    fn step_from(&self, origin: &Self, step: &mut [f64]) {
        let (dphi_rad, dp_m) = self.perturbation_from(origin);
        step[..3].copy_from_slice(dphi_rad.as_slice());
        step[3..].copy_from_slice(dp_m.as_slice());
    }
}

/// The columns of an unknown outside the chain.
pub struct Block<T> {
    first: usize,
    unknown: PhantomData<fn() -> T>,
}

impl<T: Unknown> Block<T> {
    /// Its columns, one for each parameter of a step.
    pub fn columns(self) -> Range<usize> {
        self.first..self.first + T::DIMENSION
    }
}

// Derived impls would require the same traits of the unknown.
impl<T> Clone for Block<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Block<T> {}

impl<T> fmt::Debug for Block<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Block({}..)", self.first)
    }
}

/// Hands out columns to unknowns, one block after the other.
#[derive(Debug, Clone, Default)]
pub struct Columns {
    /// Columns handed out.
    pub count: usize,
}

impl Columns {
    /// The columns of one more unknown.
    pub fn block<T: Unknown>(&mut self) -> Block<T> {
        let first = self.count;
        self.count += T::DIMENSION;
        Block {
            first,
            unknown: PhantomData,
        }
    }
}

/// A parameter outside the chain: held at its value, or estimated about its start value.
#[derive(Debug, Clone)]
pub struct Parameter<T> {
    pub value: T,
    start: T,
    block: Option<Block<T>>,
}

impl<T: Unknown> Parameter<T> {
    /// A parameter that is held.
    pub fn held(value: T) -> Self {
        Self {
            start: value.clone(),
            value,
            block: None,
        }
    }

    /// Estimates it in columns of its own, about its present value.
    pub fn estimate(&mut self, columns: &mut Columns) {
        self.block = Some(columns.block());
    }

    /// Its columns; `None` if it is held.
    pub fn block(&self) -> Option<Block<T>> {
        self.block
    }
}

/// A parameter of any kind, which takes its part of a step of all columns.
pub trait Retract {
    /// Moves the parameter by its part of a step.
    fn retract(&mut self, step: &[f64]);

    /// Writes its deviation from the start value.
    fn correction(&self, step: &mut [f64]);
}

impl<T: Unknown> Retract for Parameter<T> {
    fn retract(&mut self, step: &[f64]) {
        if let Some(block) = self.block {
            self.value = self.value.retracted(&step[block.columns()]);
        }
    }

    fn correction(&self, step: &mut [f64]) {
        if let Some(block) = self.block {
            let step = &mut step[block.columns()];
            self.value.step_from(&self.start, step);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::so3::exp;

    fn assert_inverse<T: Unknown + fmt::Debug>(value: &T) {
        let step: Vec<f64> = (0..T::DIMENSION).map(|i| 0.3 - 0.2 * i as f64).collect();
        let mut inverted = vec![0.0; T::DIMENSION];
        value.retracted(&step).step_from(value, &mut inverted);
        for (a, b) in step.iter().zip(&inverted) {
            assert!((a - b).abs() < 1e-14, "{value:?}: {inverted:?}");
        }
    }

    #[test]
    fn step_from_inverts_retracted() {
        let (rotation, t) = (exp(&Vec3::new(0.4, -1.2, 2.0)), Vec3::new(3.0, -1.0, 0.5));
        assert_inverse(&4.0);
        assert_inverse(&Vec3::new(1.0, 2.0, -3.0));
        assert_inverse(&WorldFromBody::new(rotation, t));
        assert_inverse(&BodyFromScanner::new(rotation, t));
    }

    #[test]
    fn parameters_take_their_part_of_a_step() {
        let mut columns = Columns::default();
        let mut gravity = Parameter::held(9.81);
        let mut held = Parameter::held(Vec3::x());
        let mut mounting = Parameter::held(BodyFromScanner::identity());
        let mut patch = Parameter::held(Vec3::y());
        gravity.estimate(&mut columns);
        mounting.estimate(&mut columns);
        patch.estimate(&mut columns);
        let places = (
            gravity.block().map(Block::columns),
            mounting.block().map(Block::columns),
        );
        assert_eq!(places, (Some(0..1), Some(1..7)));
        assert_eq!((held.block().is_none(), columns.count), (true, 10));
        let step: Vec<f64> = (0..10).map(|i| 0.1 * f64::from(i)).collect();
        let mut corrections = vec![f64::NAN; 10];
        let all: [&mut dyn Retract; 4] = [&mut gravity, &mut held, &mut mounting, &mut patch];
        for parameter in all {
            parameter.retract(&step);
            parameter.correction(&mut corrections);
        }
        for (a, b) in step.iter().zip(&corrections) {
            assert!((a - b).abs() < 1e-14, "{corrections:?}");
        }
        assert_eq!(held.value, Vec3::x());
    }
}
