//! One scale of the coarse-to-fine adjustment, and its possible endings.

use std::f64::consts::PI;
use std::fmt;
use std::sync::Arc;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::cost::{NormalEquations, cost, noise_of_normals, normal_equations};
use super::input::Input;
use super::observability::Observability;
use super::parameters::{Mounting, poses};
use super::settings::{CalibrationSettings, Reach};
use crate::error::Result;
use crate::statistics::median;
use crate::surface::{Surface, SurfaceCloud};

/// The adjustment problem of one scale.
#[derive(Debug, Clone)]
pub struct ScaleProblem {
    /// The thinned points.
    pub cloud: Arc<SurfaceCloud>,
    /// Edge of the voxels, metres.
    pub voxel_m: f64,
    /// s of the [`cost`](super::cost), the floor of the thickness, metres.
    pub floor_m: f64,
    /// Number of points in each neighbourhood.
    pub k: usize,
    /// Every `stride`-th scanner point is a centre.
    pub stride: usize,
    /// Maximum number of iterations.
    pub max_iterations: usize,
    /// Time after which a scanner that comes back begins another pass, seconds.
    pub pass_gap_s: f64,
}

/// The surface and the normal equations at given mountings.
#[derive(Debug, Clone)]
pub struct State {
    /// The mountings.
    pub mountings: Vec<Mounting>,
    /// Points and planes.
    pub surface: Surface,
    /// Σ ln(λ₃ + s²).
    pub cost: f64,
    /// Derivatives of the cost.
    pub equations: NormalEquations,
}

impl ScaleProblem {
    /// The problem of the points that are thinned with voxels of this size, placed with `mountings`, with at most so many
    /// centres.
    ///
    /// # Errors
    /// Too few points for neighbourhoods.
    pub fn new(
        input: &Input<'_>,
        mountings: &[Mounting],
        voxel_m: f64,
        most_centres: usize,
        settings: &CalibrationSettings,
    ) -> Result<Self> {
        let cloud = input.thinned(mountings, voxel_m, settings)?;
        Ok(Self {
            stride: cloud.movable.len().div_ceil(most_centres).max(1),
            cloud: Arc::new(cloud),
            voxel_m,
            floor_m: input.floor_m(voxel_m),
            k: settings.neighbours,
            max_iterations: settings.max_iterations,
            pass_gap_s: settings.pass_gap_s,
        })
    }

    /// The median range of the scanner points, metres; `None` without any.
    pub fn range_m(&self) -> Option<f64> {
        let points = self.cloud.movable.iter();
        median(points.map(|point| point.position_m.norm()))
    }

    /// Searches the neighbourhoods at `mountings` and builds the normal equations.
    pub fn at(&self, mountings: Vec<Mounting>) -> State {
        let cloud = Arc::clone(&self.cloud);
        let surface = Surface::new(cloud, &poses(&mountings), self.k, self.stride);
        self.state(mountings, surface)
    }

    /// A state with what the data determine there. Over flat ground, noise of normals looks like information on slides, and
    /// steps that follow it lead astray.
    pub fn solved(&self, state: State) -> Solved {
        let State {
            equations,
            mountings,
            surface,
            ..
        } = &state;
        let noise_of_normals = noise_of_normals(surface, self.floor_m);
        let observability = Observability::new(equations, mountings).beyond_noise(
            equations,
            &noise_of_normals,
            mountings,
        );
        Solved {
            observability,
            noise_of_normals,
            floor_m: self.floor_m,
            width_m: self.width_m(),
            state,
        }
    }

    /// Whether some point lies farther apart with `there` than with `here`, at the median range, than initial values can be
    /// wrong.
    pub fn is_far(&self, here: &[Mounting], there: &[Mounting]) -> bool {
        let range_m = self.range_m().unwrap_or(0.0);
        let apart_m = self.cloud.largest_displacement(&poses(here), &poses(there));
        apart_m > Reach::WRONG.displacement_m(range_m)
    }

    /// The width of a neighbourhood, metres: k points, one in each voxel of a surface, are a disc with a diameter of
    /// 2 √(k/π) voxels.
    pub fn width_m(&self) -> f64 {
        2.0 * (self.k as f64 / PI).sqrt() * self.voxel_m
    }

    /// Whether half of a scanner's points have moved farther than neighbourhoods reach from their centres: what made clouds
    /// agree with `here` says nothing about `there`.
    pub fn has_left(&self, here: &[Mounting], there: &[Mounting]) -> bool {
        let reach_m = 0.5 * self.width_m();
        let moved_m = self.cloud.median_displacements(&poses(here), &poses(there));
        moved_m.iter().any(|moved_m| *moved_m > reach_m)
    }

    /// Builds the normal equations of a surface placed with `mountings`.
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
    /// The last state.
    pub state: State,
    /// How it ended.
    pub ending: Ending,
    /// Number of steps, accepted and rejected.
    pub iterations: usize,
    /// The method's own cost before the first step and after every iteration, as a mean over the neighbourhoods.
    pub costs: Vec<f64>,
}

/// A scale at its solution.
#[derive(Debug, Clone)]
pub struct Solved {
    /// The solution.
    pub state: State,
    /// What the data determine at the solution.
    pub observability: Observability,
    /// What noise of normals adds to the normal matrix on average.
    pub noise_of_normals: DMatrix<f64>,
    /// s of the cost, metres.
    pub floor_m: f64,
    /// Width of the neighbourhoods, metres.
    pub width_m: f64,
}

/// How a scale ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Ending {
    /// The last step was below the threshold.
    #[serde(rename = "converged")]
    Converged,
    /// No damped step lowers the cost further.
    #[serde(rename = "converged at the minimum of the cost")]
    CostFloor,
    /// New neighbourhoods no longer lower the cost; the best mountings so far are the result.
    #[serde(rename = "converged: new neighbourhoods no longer lower the cost")]
    Alternating,
    /// A coarse scale whose clouds agree.
    #[serde(rename = "aligned")]
    Aligned,
    /// The clouds fit better only farther away than initial values can be wrong, or than neighbourhoods reach, where they
    /// have separated or lost their relief: the mountings stay as the scale began. The finest scale has then not reached its
    /// minimum.
    #[serde(rename = "kept at the start: fits better only far away")]
    Kept,
    /// There are several clouds, but no neighbourhood holds points of two: each may be flattest wherever it is. The
    /// mountings stay as the scale began, and the finest scale has not reached a minimum.
    #[serde(rename = "kept at the start: the clouds lie apart")]
    Apart,
    /// The data determine no direction of a step.
    #[serde(rename = "not determined by the data")]
    NotDetermined,
    /// The maximum number of iterations was reached.
    #[serde(rename = "stopped at the maximum number of iterations")]
    IterationsExhausted,
}

impl Ending {
    /// Whether more iterations would not have changed the result.
    pub fn is_converged(self) -> bool {
        matches!(
            self,
            Self::Converged
                | Self::CostFloor
                | Self::Alternating
                | Self::Aligned
                | Self::Kept
                | Self::Apart
        )
    }

    /// Whether the mountings stay as the scale began.
    pub fn is_kept(self) -> bool {
        matches!(self, Self::Kept | Self::Apart)
    }
}

impl fmt::Display for Ending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::adjust::minimise;
    use crate::calibration::hold_unobservable_directions;
    use crate::calibration::small_case::{case, ground, problem};
    use crate::geometry::{Vec3, so3};
    use crate::progress::Silent;

    /// How far the right scanner is from its initial place after an adjustment of this place, which began elsewhere, over
    /// ground with hills of this height, metres.
    fn slide_m(relief_m: f64) -> f64 {
        let (cloud, mut initial) = ground(relief_m);
        initial[0].fixed = [true; 6];
        initial[1].fixed = [false, false, true, true, true, true];
        let mut start = initial.clone();
        start[1].body_from_scanner.translation_m += Vec3::new(0.02, -0.03, 0.0);
        let problem = ScaleProblem {
            floor_m: 1e-3,
            ..problem(cloud)
        };
        let begin = hold_unobservable_directions(&problem, &initial, problem.at(start));
        let end = minimise(&problem, begin.state, &begin.observability, &Silent).unwrap();
        let places = [&initial, &end.state.mountings].map(|m| m[1].body_from_scanner.translation_m);
        (places[1] - places[0]).norm()
    }

    #[test]
    fn slides_over_flat_ground_stay_at_the_initial_values() {
        let [flat_m, hills_m] = [0.0, 0.1].map(slide_m);
        println!("{flat_m} {hills_m}");
        // Both directions of the place are held; hills show where it was, to several of its standard deviations.
        assert!(flat_m < 1e-9 && (1e-5..3e-3).contains(&hills_m));
    }

    /// Discs of 20 voxels of 0.5 m reach 1.26 m from their centres.
    #[test]
    fn points_leave_their_neighbourhoods_beyond_the_reach_of_these() {
        let (cloud, here) = case();
        let problem = problem(cloud);
        let shifted = |shift_m: f64| {
            let mut there = here.clone();
            let pose = &mut there[1].body_from_scanner;
            *pose = pose.perturbed(&Vec3::zeros(), &(Vec3::y() * shift_m));
            problem.has_left(&here, &there)
        };
        assert!(!shifted(1.25) && shifted(1.27));
        // A turn about the points moves them little, however far it moves the scanner.
        let mut there = here.clone();
        let pose = &mut there[0].body_from_scanner;
        let centre = pose.map(&(Vec3::z() * -1.0));
        let turn = so3::exp(&(Vec3::x() * 2.9));
        pose.rotation = turn * pose.rotation;
        pose.translation_m = centre + turn * (pose.translation_m - centre);
        assert!(!problem.has_left(&here, &there));
    }
}
