//! Tests whether a rigid mounting and the stated noise explain the observations.
//!
//! If the mounting bends or the reference is displaced, the adjustment fits a wrong world: scans agree
//! with each other while poses are millimetres off. The sensors that do not see the ground reveal it.

use super::bend::Rung;
use super::components::Component;
use super::motion::PositionBlocks;
use super::pattern::motion_left;
use super::problem::JointProblem;
use super::result::{AdjustedDrive, Joint};
use super::state::State;

/// End of the name of an IMU's group; drives without an IMU have poses from a file.
pub const IMU: &str = "imu";
/// Largest Ω/r of the IMU, without the allowance for chance.
const MAX_IMU_RATIO: f64 = 1.2;
/// Allowance for chance in Ω/r, standard deviations.
const CHANCE_SIGMAS: f64 = 2.0;
/// Largest part of the scans' squared residuals that a motion of the mountings may explain, relative to the part
/// that it explains by chance: ten times the value of rigid mountings on fields of soil, clods and plants.
pub const MAX_MOTION_LEFT: f64 = 3.0;
/// A contradiction by the IMU is evident if it exceeds its limit by this factor. Before the noise of the scans is
/// estimated, that of a cloddy field with plants appears as 1.5 times the limit.
pub const EVIDENT_TO_IMU: f64 = 2.0;
/// A contradiction by the scans is evident if it exceeds its limit by this factor, one step after points have been
/// sorted again: correct models then give 0.3, and before the step up to 16 times the limit.
pub const EVIDENT_TO_SCANS: f64 = 4.0;
/// Largest plausible motion of mountings along and about each axis, root mean square, metres and radians: several
/// times that of the softest simulated frame.
const MAX_MOTION: [f64; 2] = [0.05, 0.05];
/// Length of the blocks of position residuals that are tested, seconds.
pub const DECIDING_BLOCK_S: f64 = 30.0;
/// Lengths of the blocks that are reported, seconds.
pub const BLOCKS_S: [f64; 3] = [2.0, 10.0, DECIDING_BLOCK_S];
/// Largest root mean square of the normalised means over the tested blocks.
pub const MAX_BLOCK_RMS: f64 = 2.0;
/// Fewest blocks for the test.
const MIN_BLOCKS: usize = 4;

/// The largest Ω/r of an IMU with this redundancy that noise explains.
pub fn max_imu_ratio(redundancy: f64) -> f64 {
    MAX_IMU_RATIO * (1.0 + CHANCE_SIGMAS * (2.0 / redundancy).sqrt())
}

/// The drive in words, if there are several.
fn of_drive(name: &str, drives: usize) -> String {
    match drives {
        1 => String::new(),
        _ => format!(" of drive `{name}`"),
    }
}

/// The contradiction between the scans of a drive and the mountings of a rung, in words.
pub fn scan_contradiction(of_drive: &str, rung: Rung, motion_left: f64) -> String {
    format!(
        "the scans{of_drive} contradict a {} mounting: a motion of it would explain {motion_left:.0} times as much \
         of their residuals as chance does (at most {MAX_MOTION_LEFT:.0})",
        rung.name(),
    )
}

/// The contradiction between the IMU of a drive and the mountings of a rung, in words, given the name of its group,
/// Ω/r, and r.
pub fn imu_contradiction(
    group: &str,
    of_drive: &str,
    rung: Rung,
    ratio: f64,
    redundancy: f64,
) -> String {
    let (who, contradict, whose) = if group.ends_with(IMU) {
        ("the IMU", "contradicts", "its")
    } else {
        ("the poses", "contradict", "their")
    };
    format!(
        "{who}{of_drive} {contradict} a {} mounting: the squares of {whose} residuals are {ratio:.1} \
         times what {whose} noise explains (at most {:.2})",
        rung.name(),
        max_imu_ratio(redundancy)
    )
}

/// The contradictions of IMUs to the present rung that exceed their limit by the factor `times`, given the component
/// of each group. They show best before the noise of the scans is estimated, because that estimate takes most of a
/// motion of the mountings for noise.
pub fn imu_contradictions(
    problem: &JointProblem<'_>,
    state: &State,
    components: &[Component],
    times: f64,
) -> Vec<String> {
    let texts = with_imu(problem).filter_map(|(drive, of_drive)| {
        let group = problem.groups.first_motion[drive];
        let (imu, name) = (&components[group], problem.groups.names[group].as_str());
        let ratio = imu.ratio()?;
        let is_against = ratio > times * max_imu_ratio(imu.redundancy);
        is_against.then(|| imu_contradiction(name, &of_drive, state.rung(), ratio, imu.redundancy))
    });
    texts.collect()
}

/// The contradictions of the scans to the present rung that exceed their limit by the factor `times`.
pub fn scan_contradictions(problem: &JointProblem<'_>, state: &State, times: f64) -> Vec<String> {
    let left = motion_left(problem, state);
    let texts = with_imu(problem).filter_map(|(drive, of_drive)| {
        let is_against = left[drive] > times * MAX_MOTION_LEFT;
        is_against.then(|| scan_contradiction(&of_drive, state.rung(), left[drive]))
    });
    texts.collect()
}

/// The drives with an IMU, and their names in messages. Drives with poses from a file are left out, because such poses
/// follow the scans just as a mounting would.
fn with_imu(problem: &JointProblem<'_>) -> impl Iterator<Item = (usize, String)> {
    let drives = &problem.input.drives;
    let groups = problem.groups.first_motion.iter();
    let each = drives.iter().zip(groups).enumerate();
    each.filter(|(_, (_, group))| problem.groups.names[**group].ends_with(IMU))
        .map(|(index, (drive, _))| (index, of_drive(&drive.name, drives.len())))
}

/// The factor by which residuals exceed their noise: the largest of √(Ω/r) of the IMUs and of the means of positions over
/// blocks, which is the standard deviation of what the model misses; at least 1.
pub fn misfit(joint: &Joint) -> f64 {
    let imus = joint.drives.iter();
    let imus = imus.filter_map(|drive| joint.group(&drive.imu)?.ratio);
    let blocks = joint.drives.iter().flat_map(deciding);
    let blocks = blocks.flat_map(|blocks| blocks.rms);
    imus.map(f64::sqrt).chain(blocks).fold(1.0, f64::max)
}

/// The blocks of positions by which a drive is judged.
fn deciding(drive: &AdjustedDrive) -> impl Iterator<Item = &PositionBlocks> {
    let decides = |blocks: &&PositionBlocks| {
        blocks.block_s == DECIDING_BLOCK_S && blocks.blocks >= MIN_BLOCKS
    };
    drive.positions.iter().filter(decides)
}

/// The contradictions to the model, gravest first.
pub fn contradictions(joint: &Joint) -> Vec<String> {
    let mut texts = Vec::new();
    let too_far = joint
        .motion()
        .filter(|[shift_m, turn_rad]| *shift_m > MAX_MOTION[0] || *turn_rad > MAX_MOTION[1]);
    texts.extend(too_far.map(|[shift_m, turn_rad]| {
        format!(
            "the mountings would have to move by {:.0} mm and {:.1}° about each axis (root mean square), \
             farther than frames bend (at most {:.0} mm and {:.1}°)",
            1e3 * shift_m,
            turn_rad.to_degrees(),
            1e3 * MAX_MOTION[0],
            MAX_MOTION[1].to_degrees()
        )
    }));
    for drive in &joint.drives {
        let of_drive = of_drive(&drive.name, joint.drives.len());
        if let Some(imu) = joint.group(&drive.imu)
            && let Some(ratio) = imu.ratio
            && ratio > max_imu_ratio(imu.redundancy)
        {
            let (rung, redundancy) = (joint.rung, imu.redundancy);
            texts.push(imu_contradiction(
                &drive.imu, &of_drive, rung, ratio, redundancy,
            ));
        }
        if drive.imu.ends_with(IMU) && drive.motion_left > MAX_MOTION_LEFT {
            texts.push(scan_contradiction(&of_drive, joint.rung, drive.motion_left));
        }
        for blocks in deciding(drive) {
            let worst = blocks.rms.iter().copied().fold(0.0, f64::max);
            if worst > MAX_BLOCK_RMS {
                let (what, likely) = match joint.reference {
                    Some(_) => (
                        "scans and reference",
                        "the mounting bends, or the reference is shifted",
                    ),
                    None => (
                        "the scans",
                        "the mounting moves in another way, or was changed",
                    ),
                };
                texts.push(format!(
                    "`{}`{of_drive} contradicts {what}: means of its residuals over {:.0} s reach {worst:.1} standard \
                     deviations (at most {MAX_BLOCK_RMS:.0}): {likely}",
                    blocks.sensor,
                    blocks.block_s,
                ));
            }
        }
    }
    texts
}
