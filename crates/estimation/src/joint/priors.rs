//! Rows of the priors, known or assumed: surfels, the reference's errors, constants and mountings.

use nalgebra::DVector;

use super::bend::BENDING;
use super::layout::{REFERENCE, UP};
use super::motion::rows_together;
use super::problem::JointProblem;
use super::row::{HELD_SIGMA, RowBatch};
use super::state::State;
use super::surfel::{LEAST_SIGMA_M, ReferencePlane, SlopeOfPlane, Surfel};
use crate::calibration::parameters::{change, euler_jacobian_body};
use crate::calibration::{INITIAL_SIGMA, Mounting};
use crate::geometry::Vec3;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::heading::wrap;
use crate::geometry::so3::right_jacobian_inverse;

/// Standard deviations of the position (metres) and rotation of a mounting that another adjustment knows, beside its
/// covariance: so wide that they add nothing.
const KNOWN_SIGMA: [f64; 2] = [1.0, 1.0];
/// Least standard deviations of the reference's offset (metres) and slopes.
const LEAST_PLANE_SIGMA: [f64; 3] = [LEAST_SIGMA_M, 1e-4, 1e-4];

/// Share of the standard deviation of initial values to which a direction of the mountings is held.
const HELD_SHARE: f64 = 1e-4;

/// The reference's prior of one of (a, b, c) of a surfel.
pub struct ReferenceRow {
    /// a, b or c minus the reference's value, in standard deviations.
    pub residual: f64,
    /// Inverse standard deviation.
    pub weight: f64,
    /// Derivatives of the difference by (a, b, c).
    pub by_shape: [f64; 3],
    /// Derivatives of the reference's value by the error of the whole reference.
    pub by_error: [f64; REFERENCE],
}

impl JointProblem<'_> {
    /// The reference's priors of (a, b, c) of a surfel that lies on it.
    pub fn reference_rows(
        &self,
        surfel: &Surfel,
        prior: &ReferencePlane,
        shape: &Vec3,
        state: &State,
    ) -> [ReferenceRow; 3] {
        let scale = self.groups.scale[self.groups.first_reference + surfel.class];
        let [normal, u_axis, v_axis] = surfel.axes;
        let place = &self.association.reference;
        let arm = surfel.centre_m - place.centre_m;
        let remaining = place.remaining(&state.reference);
        let [x, y, z, turn @ ..] = remaining;
        let moved_m = Vec3::new(x, y, z) + Vec3::from(turn).cross(&arm);
        // The offset is the height of the reference's mean point, which moves along the surfel too: as for the mean of
        // scanned points, the plane of the surfel is then taken at another place. Without this, a shift of reference and
        // scans together along a board would seem to part them by their difference in slope, which is only noise.
        let across = normal - u_axis * shape.y - v_axis * shape.z;
        // Derivatives of the offset and slopes of the reference's plane by its shift and rotation.
        let by_error = [
            (across, arm.cross(&across)),
            (Vec3::zeros(), u_axis.cross(&normal)),
            (Vec3::zeros(), v_axis.cross(&normal)),
        ];
        std::array::from_fn(|i| {
            let (s, t) = by_error[i];
            let by_error = [s.x, s.y, s.z, t.x, t.y, t.z];
            let terms = by_error.iter().zip(&remaining);
            let mut value = terms.map(|(a, b)| a * b).sum::<f64>();
            if i == 0 {
                value += state.patches[prior.patch as usize];
            }
            let weight = 1.0 / (surfel.plane_sigma[i] * scale).hypot(LEAST_PLANE_SIGMA[i]);
            let mut by_shape = [0.0; 3];
            if i == 0 {
                by_shape = [1.0, u_axis.dot(&moved_m), v_axis.dot(&moved_m)];
            } else {
                by_shape[i] = 1.0;
            }
            ReferenceRow {
                residual: (shape[i] - value) * weight,
                weight,
                by_shape,
                by_error,
            }
        })
    }

    /// The slopes of the plane in which a surfel lies with others; `None` without one.
    pub fn slopes_of_plane(&self, surfel: &Surfel, state: &State) -> Option<[SlopeOfPlane; 2]> {
        let plane = surfel.assumed.plane? as usize;
        Some(self.association.planes[plane].along(state.planes[plane], surfel))
    }

    /// Priors of surfels and of the reference's surface errors.
    pub fn surface(&self, state: &State, batch: &mut RowBatch) {
        let surfels = self
            .association
            .surfels
            .iter()
            .zip(&state.shapes)
            .enumerate();
        for (index, (surfel, shape)) in surfels {
            let block = self.layout.first_surfel + index;
            let Some(prior) = &surfel.prior else {
                let slopes = self.slopes_of_plane(surfel, state);
                for (i, sigma) in surfel.assumed.sigma.iter().enumerate() {
                    let mut by = [0.0; 3];
                    by[i] = 1.0 / sigma;
                    let slope = i.checked_sub(1).zip(slopes.as_ref());
                    let slope = slope.map(|(slope, slopes)| &slopes[slope]);
                    let assumed = slope.map_or(0.0, |slope| slope.value);
                    batch.begin(self.groups.assumed, 1.0, (shape[i] - assumed) / sigma);
                    batch.touch(block, &by);
                    if let (Some(slope), Some(plane)) = (slope, surfel.assumed.plane) {
                        let by = slope.by_plane.map(|by| -by / sigma);
                        batch.touch(self.layout.first_plane + plane as usize, &by);
                    }
                }
                continue;
            };
            let group = self.groups.first_reference + surfel.class;
            let rows = self.reference_rows(surfel, prior, shape, state);
            for (i, row) in rows.iter().enumerate() {
                let w = row.weight;
                batch.begin(group, 1.0, row.residual);
                batch.touch(block, &row.by_shape.map(|x| x * w));
                if i == 0 && self.surface_m > 0.0 {
                    batch.touch(self.layout.first_patch + prior.patch as usize, &[-w]);
                }
                if let Some(reference) = self.layout.reference {
                    batch.touch(reference, &row.by_error.map(|x| -x * w));
                }
            }
        }
        let sigma = self.surface_m.max(HELD_SIGMA);
        for (patch, value) in state.patches.iter().enumerate() {
            batch.begin(self.groups.surface, 1.0, value / sigma);
            batch.touch(self.layout.first_patch + patch, &[1.0 / sigma]);
        }
    }

    /// Priors of the motion of mountings.
    pub fn bending(&self, state: &State, batch: &mut RowBatch) {
        let Some(bends) = &state.bends else {
            return;
        };
        let group = self.groups.assumed;
        let scanners = bends.compliance.iter().zip(&bends.prior);
        for ((compliance, [mean, sigma]), &block) in scanners.zip(&self.layout.compliance) {
            let unknowns = bends.unknowns();
            for (i, value) in compliance[..unknowns].iter().enumerate() {
                let w = 1.0 / sigma[i].max(HELD_SIGMA);
                let mut by = [0.0; BENDING];
                by[i] = w;
                batch.begin(group, 1.0, (value - mean[i]) * w);
                batch.touch(block, &by[..unknowns]);
            }
        }
        for (processes, firsts) in bends.knots.iter().zip(&self.layout.knots) {
            let processes: Vec<_> = processes.iter().zip(firsts.iter().copied()).collect();
            let together = |component: usize| bends.together[component / 3];
            let knots = processes.first().map_or(0, |(p, _)| p.knot_s.len());
            (0..knots).for_each(|knot| rows_together(&processes, &together, knot, group, batch));
        }
    }

    /// Priors of the unknowns that couple with everything.
    pub fn assumed(&self, state: &State, batch: &mut RowBatch) {
        let group = self.groups.assumed;
        if let Some(reference) = self.layout.reference {
            let sigma = self.settings.reference;
            for (i, value) in state.reference.iter().enumerate() {
                let sigma = match i {
                    UP => HELD_SIGMA,
                    0..UP => sigma.shift_m.max(HELD_SIGMA),
                    _ => sigma.tilt_rad.max(HELD_SIGMA),
                };
                let mut by = [0.0; REFERENCE];
                by[i] = 1.0 / sigma;
                batch.begin(group, 1.0, value * by[i]);
                batch.touch(reference, &by);
            }
        }
        for (place, (drive, column)) in self.layout.constant_owner.iter().enumerate() {
            let constant = &state.motions[*drive].constants()[*column];
            let w = 1.0 / constant.prior_sigma;
            batch.begin(group, 1.0, constant.correction * w);
            batch.touch(self.layout.first_constant + place, &[w]);
        }
        for (late, value) in self.layout.of_scanners.late.iter().zip(&state.late_s) {
            if let Some(block) = late {
                batch.begin(group, 1.0, *value);
                batch.touch(*block, &[1.0]);
            }
        }
        self.mountings(state, batch);
    }

    /// Changes of all unknowns, with each held direction of the mountings one standard deviation of initial values off,
    /// given the state of the last factor.
    pub fn sides_of_held(&self, state: &State) -> Vec<Vec<f64>> {
        let Some(factor) = &self.factor else {
            return Vec::new();
        };
        let from_initial = change(self.input.initial, &state.mountings);
        let side = |held: &DVector<f64>| {
            let direction = held_direction(held, &from_initial);
            let mut side = vec![0.0; self.unknowns()];
            for (scanner, &block) in self.layout.mountings.iter().enumerate() {
                // The unknowns are (δφ, δp).
                for i in 0..6 {
                    // Moves the row that holds it.
                    let by = direction[6 * scanner + (i + 3) % 6];
                    side[self.offset(block) + i] = by / (HELD_SHARE * HELD_SHARE);
                }
            }
            factor.solve(&mut side, 1);
            side
        };
        self.input.held.iter().map(side).collect()
    }

    /// Priors of the mountings: initial values, fixed parameters, held directions and known values.
    fn mountings(&self, state: &State, batch: &mut RowBatch) {
        let from_start = change(&self.input.mountings, &state.mountings);
        let from_initial = change(self.input.initial, &state.mountings);
        let mut add = |direction: &[f64], moved: f64, weight: f64| {
            batch.begin(self.groups.assumed, 1.0, moved * weight);
            for (scanner, block) in self.layout.mountings.iter().enumerate() {
                let part = &direction[6 * scanner..6 * scanner + 6];
                if part.iter().any(|x| *x != 0.0) {
                    // The unknowns are (δφ, δp).
                    let by = [part[3], part[4], part[5], part[0], part[1], part[2]];
                    batch.touch(*block, &by.map(|x| x * weight));
                }
            }
        };
        let initial_sigma = match self.known {
            Some(_) => KNOWN_SIGMA,
            None => INITIAL_SIGMA,
        };
        let count = 6 * state.mountings.len();
        let starts = self.input.mountings.iter();
        for (scanner, (mounting, start)) in state.mountings.iter().zip(starts).enumerate() {
            let angles = euler_jacobian_body(mounting.convention, &mounting.body_from_scanner);
            let turned = turned_rad(start, mounting);
            let place = 6 * scanner;
            // Log(Exp(ε) Exp(δφ)) ≈ δφ + J_r⁻¹(δφ)ᵀ ε.
            let turn =
                right_jacobian_inverse(&from_initial.fixed_rows::<3>(place + 3).into_owned());
            for parameter in 0..6 {
                let mut direction = vec![0.0; count];
                direction[place + parameter] = 1.0;
                let mut by = direction.clone();
                if parameter >= 3 {
                    by[place + 3..place + 6].copy_from_slice(turn.column(parameter - 3).as_slice());
                }
                let moved = from_initial[place + parameter];
                add(&by, moved, 1.0 / initial_sigma[parameter / 3]);
                if !mounting.fixed[parameter] {
                    continue;
                }
                let mut moved = from_start[place + parameter];
                if parameter >= 3 {
                    direction[place + parameter] = 0.0;
                    for axis in 0..3 {
                        direction[place + 3 + axis] = angles[(parameter - 3, axis)];
                    }
                    moved = turned[parameter - 3];
                }
                add(&direction, moved, 1.0 / HELD_SIGMA);
            }
        }
        for held in self.input.held {
            let direction = held_direction(held, &from_initial);
            add(
                direction.as_slice(),
                held.dot(&from_initial),
                1.0 / HELD_SHARE,
            );
        }
        for row in self.known.iter().flat_map(|w| w.row_iter()) {
            let direction: Vec<f64> = row.iter().copied().collect();
            let terms = direction.iter().zip(from_start.iter());
            let moved = terms.map(|(a, b)| a * b).sum();
            add(&direction, moved, 1.0);
        }
    }
}

/// The derivative of what is held by the mountings (δp, δφ), which are off their initial values.
fn held_direction(held: &DVector<f64>, from_initial: &DVector<f64>) -> DVector<f64> {
    let mut direction = held.clone();
    for place in (3..held.len()).step_by(6) {
        let turned = from_initial.fixed_rows::<3>(place).into_owned();
        let by = right_jacobian_inverse(&turned) * held.fixed_rows::<3>(place);
        direction.fixed_rows_mut::<3>(place).copy_from(&by);
    }
    direction
}

/// Change of each Euler angle, radians. The rotation vector would give it to first order only, which is
/// not enough for an angle that is held to [`HELD_SIGMA`].
fn turned_rad(start: &Mounting, now: &Mounting) -> [f64; 3] {
    let angles_deg = |mounting: &Mounting| {
        euler_deg_from_rotation(now.convention, &mounting.body_from_scanner.rotation)
    };
    let (from, to) = (angles_deg(start), angles_deg(now));
    std::array::from_fn(|i| wrap((to[i] - from[i]).to_radians()))
}
