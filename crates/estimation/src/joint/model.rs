//! Whether a rigid mounting and the stated noise explain the observations.
//!
//! Where the mounting bends or the reference is displaced, the adjustment fits a wrong world: scans
//! agree with each other while poses are millimetres off. The sensors that do not see the ground
//! notice.

use super::bend::Rung;
use super::components::Component;
use super::pattern::motion_left;
use super::problem::JointProblem;
use super::result::Joint;
use super::state::State;

/// Ends the name of the group of an IMU; drives without one have poses from a file.
pub const IMU: &str = "imu";
/// Largest Ω/r of the IMU, before chance.
const MAX_IMU_RATIO: f64 = 1.2;
/// Standard deviations by which chance may raise it.
const CHANCE_SIGMAS: f64 = 2.0;
/// Largest part of the scans' residuals that a motion explains, over what chance makes of it: ten times what
/// a rigid mounting leaves on fields of soil, clods and plants.
pub const MAX_MOTION_LEFT: f64 = 3.0;
/// A contradiction of the IMU this many times as large as the least is evident. Before the noise of scans is
/// estimated, that of a cloddy field with plants passes for 1.5 times as much.
pub const EVIDENT_TO_IMU: f64 = 2.0;
/// One of the scans is, where points are sorted anew after the coarse round and surfels lie where they are seen:
/// models that are right leave up to 2.6 then on simulated drives, less than what contradicts.
pub const EVIDENT_TO_SCANS: f64 = 4.0;
/// Mountings that move farther than this about each axis, root mean square, metres and radians, belong to no
/// frame: several times what the softest of the simulated ones does.
const MAX_MOTION: [f64; 2] = [0.05, 0.05];
/// Length of the blocks of positions that decide, seconds.
pub const DECIDING_BLOCK_S: f64 = 30.0;
/// All lengths reported.
pub const BLOCKS_S: [f64; 3] = [2.0, 10.0, DECIDING_BLOCK_S];
/// Largest root mean square of normalised means over these blocks.
pub const MAX_BLOCK_RMS: f64 = 2.0;
/// Fewest blocks that decide.
const MIN_BLOCKS: usize = 4;

/// The largest Ω/r of an IMU with this redundancy that noise explains.
pub fn max_imu_ratio(redundancy: f64) -> f64 {
    MAX_IMU_RATIO * (1.0 + CHANCE_SIGMAS * (2.0 / redundancy).sqrt())
}

/// Which drive, in words, where there are several.
fn of_drive(name: &str, drives: usize) -> String {
    match drives {
        1 => String::new(),
        _ => format!(" of drive `{name}`"),
    }
}

/// What the scans of a drive say against mountings that move so much, in words.
pub fn of_scans(of_drive: &str, rung: Rung, motion_left: f64) -> String {
    format!(
        "the scans{of_drive} contradict a {} mounting: a motion of it would explain {motion_left:.0} times as much \
         of their residuals as chance does (at most {MAX_MOTION_LEFT:.0})",
        rung.name(),
    )
}

/// What the IMU of a drive says against mountings that move so much, in words: its group's name, Ω/r, and r.
pub fn of_imu(
    (group, of_drive): (&str, &str),
    rung: Rung,
    (ratio, redundancy): (f64, f64),
) -> String {
    let (who, contradict, whose) = match group.ends_with(IMU) {
        true => ("the IMU", "contradicts", "its"),
        false => ("the poses", "contradict", "their"),
    };
    format!(
        "{who}{of_drive} {contradict} a {} mounting: the squares of {whose} residuals are {ratio:.1} \
         times what {whose} noise explains (at most {:.2})",
        rung.name(),
        max_imu_ratio(redundancy)
    )
}

/// Where an IMU contradicts mountings that move so little by so many times the least that does, given the component
/// of each group. Before the noise of scans is estimated, that shows more: with it, most of what moves mountings
/// passes as noise.
pub fn imu_against(
    problem: &JointProblem<'_>,
    state: &State,
    (found, times): (&[Component], f64),
) -> Vec<String> {
    let said = with_imu(problem).filter_map(|(drive, of_drive)| {
        let group = problem.groups.first_motion[drive];
        let (imu, name) = (&found[group], problem.groups.names[group].as_str());
        let ratio = imu.ratio()?;
        let is_against = ratio > times * max_imu_ratio(imu.redundancy);
        is_against.then(|| of_imu((name, &of_drive), state.rung(), (ratio, imu.redundancy)))
    });
    said.collect()
}

/// Where scans do.
pub fn scans_against(problem: &JointProblem<'_>, state: &State, times: f64) -> Vec<String> {
    let left = motion_left(problem, state);
    let said = with_imu(problem).filter_map(|(drive, of_drive)| {
        let is_against = left[drive] > times * MAX_MOTION_LEFT;
        is_against.then(|| of_scans(&of_drive, state.rung(), left[drive]))
    });
    said.collect()
}

/// The drives with an IMU and how they are named: poses from a file follow the scans as a mounting would.
fn with_imu(problem: &JointProblem<'_>) -> impl Iterator<Item = (usize, String)> {
    let drives = &problem.input.drives;
    let groups = problem.groups.first_motion.iter();
    let each = drives.iter().zip(groups).enumerate();
    each.filter(|(_, (_, group))| problem.groups.names[**group].ends_with(IMU))
        .map(|(index, (drive, _))| (index, of_drive(&drive.name, drives.len())))
}

/// What contradicts the model, the gravest first.
pub fn contradictions(joint: &Joint) -> Vec<String> {
    let mut found = Vec::new();
    let too_far = joint
        .motion()
        .filter(|[shift_m, turn_rad]| *shift_m > MAX_MOTION[0] || *turn_rad > MAX_MOTION[1]);
    found.extend(too_far.map(|[shift_m, turn_rad]| {
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
        if let Some(imu) = joint.groups.iter().find(|group| group.name == drive.imu)
            && let Some(ratio) = imu.ratio
            && ratio > max_imu_ratio(imu.redundancy)
        {
            let who = (drive.imu.as_str(), of_drive.as_str());
            found.push(of_imu(who, joint.rung, (ratio, imu.redundancy)));
        }
        if drive.imu.ends_with(IMU) && drive.motion_left > MAX_MOTION_LEFT {
            found.push(of_scans(&of_drive, joint.rung, drive.motion_left));
        }
        for blocks in &drive.positions {
            let worst = blocks.rms.iter().copied().fold(0.0, f64::max);
            let decides = blocks.block_s == DECIDING_BLOCK_S && blocks.blocks >= MIN_BLOCKS;
            if decides && worst > MAX_BLOCK_RMS {
                let (what, likely) = match joint.reference {
                    Some(_) => (
                        "scans and reference",
                        "the mounting bends, or the reference is shifted",
                    ),
                    None => ("the scans", "the mounting moves otherwise, or is another"),
                };
                found.push(format!(
                    "`{}`{of_drive} contradicts {what}: means of its residuals over {:.0} s reach {worst:.1} standard \
                     deviations (at most {MAX_BLOCK_RMS:.0}): {likely}",
                    blocks.sensor,
                    blocks.block_s,
                ));
            }
        }
    }
    found
}
