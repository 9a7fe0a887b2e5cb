//! Whether a rigid mounting and the stated noise explain the observations.
//!
//! Where the mounting bends or the reference is displaced, the adjustment fits a wrong world: scans
//! agree with each other while poses are millimetres off. The sensors that do not see the ground
//! notice.

use super::result::Joint;

/// Largest Ω/r of the IMU, before chance.
const MAX_IMU_RATIO: f64 = 1.2;
/// Standard deviations by which chance may raise it.
const CHANCE_SIGMAS: f64 = 2.0;
/// Length of the blocks of positions that decide, seconds.
pub const DECIDING_BLOCK_S: f64 = 30.0;
/// All lengths reported.
pub const BLOCKS_S: [f64; 3] = [2.0, 10.0, DECIDING_BLOCK_S];
/// Largest root mean square of normalised means over these blocks.
pub const MAX_BLOCK_RMS: f64 = 2.0;
/// Fewest blocks that decide.
const MIN_BLOCKS: usize = 4;

/// The largest Ω/r of an IMU with this redundancy that a rigid mounting explains.
pub fn max_imu_ratio(redundancy: f64) -> f64 {
    MAX_IMU_RATIO * (1.0 + CHANCE_SIGMAS * (2.0 / redundancy).sqrt())
}

/// What contradicts the model, the gravest first.
pub fn contradictions(joint: &Joint) -> Vec<String> {
    let mut found = Vec::new();
    for drive in &joint.drives {
        let of_drive = |what: &str| match joint.drives.len() {
            1 => what.to_owned(),
            _ => format!("{what} of drive `{}`", drive.name),
        };
        if let Some(imu) = joint.groups.iter().find(|group| group.name == drive.imu)
            && let Some(ratio) = imu.ratio
        {
            let most = max_imu_ratio(imu.redundancy);
            if ratio > most {
                let (who, contradict, whose) = match drive.imu.ends_with("imu") {
                    true => (of_drive("the IMU"), "contradicts", "its"),
                    false => (of_drive("the poses"), "contradict", "their"),
                };
                found.push(format!(
                    "{who} {contradict} a {} mounting: the squares of {whose} residuals are {ratio:.1} \
                     times what {whose} noise explains (at most {most:.2})",
                    joint.rung.name(),
                ));
            }
        }
        for blocks in &drive.positions {
            let worst = blocks.rms.iter().copied().fold(0.0, f64::max);
            let decides = blocks.block_s == DECIDING_BLOCK_S && blocks.blocks >= MIN_BLOCKS;
            if decides && worst > MAX_BLOCK_RMS {
                found.push(format!(
                    "{} contradicts scans and reference: means of its residuals over {:.0} s reach \
                     {worst:.1} standard deviations (at most {MAX_BLOCK_RMS:.0}): the mounting \
                     bends, or the reference is shifted",
                    of_drive(&format!("`{}`", blocks.sensor)),
                    blocks.block_s,
                ));
            }
        }
    }
    found
}
