//! The result of an adjustment that has ended.

use nalgebra::DMatrix;

use super::bend::{BENDING_STEP_S, Bends, Compliance};
use super::components::Component;
use super::covariance::Covariance;
use super::directions::Directions;
use super::known::{known_points, prior_shares};
use super::layout::Groups;
use super::model::BLOCKS_S;
use super::pattern::motion_left;
use super::pose_errors::pose_errors;
use super::problem::JointProblem;
use super::result::{
    AdjustedDrive, GroupTest, Joint, Jump, MovedMounting, PoseMove, ReferenceError, SurfelPlane,
};
use super::slow::SlowMotions;
use super::state::State;
use super::surfel::Surfel;
use crate::adjustment::StopReason;
use crate::error::{Error, Problem, Result};
use crate::geometry::{Bending, Vec3};
use crate::trajectory::{EstimatedConstant, Trajectory};

/// The values of a state with their standard deviations, from the factor that the problem holds, at this state or
/// at one nearby, if mountings may also move slowly as found.
///
/// # Errors
/// Normal equations that are not positive definite.
pub fn conclude(
    problem: &JointProblem<'_>,
    state: &State,
    components: &[Component],
    slow: &SlowMotions,
    stop: StopReason,
    iterations: usize,
) -> Result<Joint> {
    let factored = problem.factored().unwrap_or(state);
    let layout = &problem.layout;
    let all = Covariance::of(problem, factored, slow).ok_or_else(not_determined)?;
    let block = |a: usize, b: usize| all.block(a, b);
    let count = state.mountings.len();
    let mut covariance = DMatrix::zeros(6 * count, 6 * count);
    // The unknowns are (δφ, δp), the covariance is given over (δp, δφ).
    let swapped = |i: usize| (i + 3) % 6;
    for (i, &a) in layout.mountings.iter().enumerate() {
        for (j, &b) in layout.mountings.iter().enumerate() {
            let part = block(a, b).ok_or_else(not_determined)?;
            for row in 0..6 {
                for column in 0..6 {
                    covariance[(6 * i + row, 6 * j + column)] =
                        part[(swapped(row), swapped(column))];
                }
            }
        }
    }
    let root = |x: f64| x.max(0.0).sqrt();
    let sigma = |a: usize| block(a, a).map(|c| root(c[(0, 0)]));
    let late_s = layout.of_scanners.late.iter().zip(&state.late_s);
    let late_s = late_s.map(|(place, value)| Some((*value, sigma((*place)?)?)));
    let scores = problem.scores(factored, &covariance);
    let constants = layout.constant_owner.iter().enumerate();
    let constants = constants.map(|(place, (drive, column))| {
        let constant = &state.motions[*drive].constants()[*column];
        let sigma = sigma(layout.first_constant + place);
        EstimatedConstant {
            name: constant.name.clone(),
            unit: constant.unit.into(),
            start: constant.base,
            value: constant.base + constant.correction,
            sigma,
        }
    });
    let bends = state.bends.as_ref();
    let compliance = bends.into_iter().flat_map(|bends| {
        let scanners = bends.compliance.iter().zip(&layout.compliance);
        scanners.map(|(bending, &place)| {
            let variances = block(place, place).map(|part| part.diagonal());
            Compliance {
                by_load: std::array::from_fn(|i| bending[i]),
                sigma: std::array::from_fn(|i| variances.as_ref().map_or(f64::NAN, |v| root(v[i]))),
                mean_load: bends.mean_load,
            }
        })
    });
    let compliance: Vec<Compliance> = compliance.collect();
    let left = motion_left(problem, state);
    let drives = problem.input.drives.iter().enumerate();
    let drives = drives.map(|(index, drive)| {
        let first = layout.first_motion[index];
        let own_block = |a: usize, b: usize| block(first + a, first + b);
        let records = state.motions[index].records(Some(&own_block));
        let before = drive.motion.records(None);
        let moved = records.iter().zip(&before).map(|(after, before)| {
            let (turn_rad, shift_m) = after
                .world_from_body
                .perturbation_from(&before.world_from_body);
            PoseMove {
                time_s: after.time_s,
                shift_m,
                turn_rad,
            }
        });
        let moved = moved.collect();
        let bending = bends.into_iter().flat_map(|bends| {
            let span_s = (records[0].time_s, records[records.len() - 1].time_s);
            (0..count).map(move |scanner| (bends, scanner, span_s))
        });
        let bending = bending.map(|(bends, scanner, span_s)| {
            let variances = bending_variances(problem, bends, (index, scanner), &block);
            MovedMounting {
                offsets: Bending::sampled(span_s, BENDING_STEP_S, |time_s| {
                    bends.offset(index, scanner, time_s)
                }),
                sigmas: Bending::sampled(span_s, BENDING_STEP_S, |time_s| {
                    variances(time_s).map(root)
                }),
            }
        });
        let bending = bending.collect();
        Ok(AdjustedDrive {
            bending,
            motion_left: left[index],
            jumps: jumps(problem, bends, index, &block),
            points: known_points(&all, state, index),
            name: drive.name.clone(),
            trajectory: Trajectory::new(records)?,
            moved,
            pose_errors: state.motions[index]
                .errors()
                .zip(drive.motion.errors())
                .and_then(|(after, before)| pose_errors(after, before, &own_block)),
            imu: problem.groups.names[problem.groups.first_motion[index]].clone(),
            positions: BLOCKS_S
                .iter()
                .flat_map(|&block_s| state.motions[index].position_blocks(block_s))
                .collect(),
            residuals: state.motions[index].position_residuals(),
        })
    });
    Ok(Joint {
        mountings: state.mountings.clone(),
        undetermined: Directions::of(&covariance).undetermined(),
        covariance,
        late_s: late_s.collect(),
        late_scores: scores.late,
        range_scores: scores.range,
        rung: state.rung(),
        ladder: Vec::new(),
        prior_shares: prior_shares(problem, state),
        compliance,
        height_score: scores.height,
        drives: drives.collect::<Result<_>>()?,
        constants: constants.collect(),
        reference: layout.reference.and_then(|place| {
            let variances = block(place, place)?.diagonal();
            let part = |first: usize| Vec3::from_fn(|i, _| root(variances[first + i]));
            let [x, y, z, turn @ ..] = state.reference;
            Some(ReferenceError {
                prior: problem.settings.reference,
                shift_m: -Vec3::new(x, y, z),
                shift_sigma_m: part(0),
                turn_rad: -Vec3::from(turn),
                turn_sigma_rad: part(3),
            })
        }),
        surface_m: problem.surface_m,
        regions: problem.association.regions.clone(),
        groups: tests(&problem.groups, components),
        stop,
        iterations,
        rows: problem
            .association
            .drives
            .iter()
            .map(|d| d.rows.len())
            .sum(),
        surfels: problem.association.surfels.len(),
        planes: planes(&problem.association.surfels, &state.shapes),
        unknowns: problem.unknowns(),
    })
}

/// The planes of surfels with their offsets and slopes (a, b, c): a + b u + c v along the normal.
fn planes(surfels: &[Surfel], shapes: &[Vec3]) -> Vec<SurfelPlane> {
    let all = surfels.iter().zip(shapes).map(|(surfel, shape)| {
        let [normal, u, v] = surfel.axes;
        SurfelPlane {
            centre_m: surfel.centre_m + shape.x * normal,
            normal: (normal - shape.y * u - shape.z * v).normalize(),
            size_m: surfel.size_m,
            roughness_m: surfel.roughness_m,
        }
    });
    all.collect()
}

/// A jump is reported if a component exceeds this many of its standard deviations.
const JUMP_SIGMAS: f64 = 4.0;

fn is_notable(jump: &Jump) -> bool {
    let mut components = jump.step.iter().zip(&jump.sigma);
    components.any(|(step, sigma)| step.abs() > JUMP_SIGMAS * sigma)
}

/// The sudden moves of the mountings in a drive.
fn jumps(
    problem: &JointProblem<'_>,
    bends: Option<&Bends>,
    drive: usize,
    block: &dyn Fn(usize, usize) -> Option<DMatrix<f64>>,
) -> Vec<Jump> {
    let of_drive = bends.and_then(|bends| bends.knots.get(drive));
    let processes = of_drive.into_iter().flatten().enumerate();
    let jumps = processes.flat_map(|(scanner, process)| {
        let first = problem.layout.knots[drive][scanner];
        process.restarts.iter().map(move |&knot| {
            let (after, before) = (process.at_knot(knot), process.at_knot(knot - 1));
            let part = |i: usize, j: usize| block(first + i, first + j).map(|part| part.diagonal());
            let variance = part(knot, knot)
                .zip(part(knot - 1, knot - 1))
                .zip(part(knot, knot - 1))
                .map(|((a, b), both)| a + b - both * 2.0);
            let sigma = |i: usize| variance.as_ref().map_or(f64::NAN, |v| v[i].max(0.0).sqrt());
            Jump {
                scanner,
                between_s: [process.knot_s[knot - 1], process.knot_s[knot]],
                step: std::array::from_fn(|i| after[i] - before[i]),
                sigma: std::array::from_fn(sigma),
            }
        })
    });
    jumps.filter(is_notable).collect()
}

/// Variances of the offsets of a scanner's mounting in a drive, by time.
fn bending_variances<'a>(
    problem: &JointProblem<'_>,
    bends: &'a Bends,
    (drive, scanner): (usize, usize),
    block: &dyn Fn(usize, usize) -> Option<DMatrix<f64>>,
) -> impl Fn(f64) -> [f64; 6] + 'a {
    let layout = &problem.layout;
    let place = layout.compliance[scanner];
    let of_causes = block(place, place);
    let process = bends.knots.get(drive).map(|of_drive| &of_drive[scanner]);
    let first = layout.knots.get(drive).map(|of_drive| of_drive[scanner]);
    let of_knots: Vec<[f64; 6]> = match (process, first) {
        (Some(process), Some(first)) => (0..process.knot_s.len())
            .map(|knot| {
                let part = block(first + knot, first + knot);
                std::array::from_fn(|i| part.as_ref().map_or(f64::NAN, |part| part[(i, i)]))
            })
            .collect(),
        _ => Vec::new(),
    };
    move |time_s| {
        let causes = bends.causes(drive, time_s);
        std::array::from_fn(|i| {
            let mut variance = 0.0;
            let causes = &causes[..bends.causes_used];
            for (a, x) in causes.iter().enumerate() {
                for (b, y) in causes.iter().enumerate() {
                    let part = of_causes
                        .as_ref()
                        .map_or(f64::NAN, |covariance| covariance[(6 * a + i, 6 * b + i)]);
                    variance += x * y * part;
                }
            }
            if let Some(process) = process {
                let (knot, u) = process.locate(time_s);
                variance += of_knots[knot][i] * (1.0 - u) + of_knots[knot + 1][i] * u;
            }
            variance
        })
    }
}

/// The tests of all groups; groups of the same name are combined.
fn tests(groups: &Groups, components: &[Component]) -> Vec<GroupTest> {
    let mut all: Vec<(String, Component)> = Vec::new();
    for (name, component) in groups.names.iter().zip(components) {
        match all.iter_mut().find(|(known, _)| known == name) {
            Some((_, sum)) => *sum = sum.and(component),
            None => all.push((name.clone(), *component)),
        }
    }
    all.iter()
        .map(|(name, component)| GroupTest::new(name, component))
        .collect()
}

/// The error of normal equations that are not positive definite.
pub fn not_determined() -> Error {
    Error::of(
        Problem::NotDetermined,
        "the joint adjustment is not determined",
        "use calibration.method = \"two-step\"",
    )
}
