//! One scale of the coarse-to-fine adjustment, and how it can end.

use std::fmt;
use std::sync::Arc;

use super::cost::{NormalEquations, cost, normal_equations};
use super::observability::Observability;
use super::parameters::{Mounting, poses};
use crate::surface::{Surface, SurfaceCloud};

/// What is adjusted at one scale.
#[derive(Debug, Clone)]
pub struct ScaleProblem {
    /// The points, thinned.
    pub cloud: Arc<SurfaceCloud>,
    /// Edge of the voxels, metres.
    pub voxel_m: f64,
    /// s of the [`cost`](super::cost): thickness below which flatness says nothing, metres.
    pub floor_m: f64,
    /// Neighbours.
    pub k: usize,
    /// Every how many-th scanner point is a centre.
    pub stride: usize,
    /// Most iterations.
    pub max_iterations: usize,
}

/// The surface and the normal equations at given mountings.
#[derive(Debug, Clone)]
pub struct State {
    /// The mountings.
    pub mountings: Vec<Mounting>,
    /// Points and planes there.
    pub surface: Surface,
    /// Σ ln(λ₃ + s²).
    pub cost: f64,
    /// Its derivatives.
    pub equations: NormalEquations,
}

impl ScaleProblem {
    /// Finds the neighbourhoods at `mountings` and builds the equations.
    pub fn at(&self, mountings: Vec<Mounting>) -> State {
        let cloud = Arc::clone(&self.cloud);
        let surface = Surface::new(cloud, &poses(&mountings), self.k, self.stride);
        self.state(mountings, surface)
    }

    /// Builds the equations of a surface placed with `mountings`.
    pub fn state(&self, mountings: Vec<Mounting>, surface: Surface) -> State {
        State {
            cost: cost(&surface.planes, self.floor_m),
            equations: normal_equations(&surface, self.floor_m),
            mountings,
            surface,
        }
    }
}

/// The adjustment of one scale.
#[derive(Debug, Clone)]
pub struct Adjusted {
    /// Where it ended.
    pub state: State,
    /// How it ended.
    pub ending: Ending,
    /// Accepted and refused steps.
    pub iterations: usize,
    /// The method's own cost before the first step and after every iteration.
    pub costs: Vec<f64>,
}

/// A scale at its solution.
#[derive(Debug, Clone)]
pub struct Solved {
    /// The solution.
    pub state: State,
    /// What the data determine there.
    pub observability: Observability,
    /// s of the cost, metres.
    pub floor_m: f64,
}

/// How a scale ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The last step was below the threshold.
    Converged,
    /// No damping lowers the cost further: the cost is at its floor.
    CostFloor,
    /// New neighbourhoods no longer lower the cost; the best mountings so far are kept.
    Alternating,
    /// The data determine no direction in which to step.
    NotDetermined,
    /// The allowed number of iterations ran out.
    IterationsExhausted,
}

impl Ending {
    /// Whether more iterations would not have changed the result.
    pub fn is_converged(self) -> bool {
        matches!(self, Self::Converged | Self::CostFloor | Self::Alternating)
    }
}

impl fmt::Display for Ending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::CostFloor => "at the floor of the cost",
            Self::Alternating => "converged as far as its neighbourhoods tell",
            Self::NotDetermined => "not determined by the data",
            Self::IterationsExhausted => "stopped at the allowed number of iterations",
        })
    }
}

/// In words.
impl serde::Serialize for Ending {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
