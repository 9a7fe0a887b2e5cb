//! Summaries of one kind of measurement.

use super::gather::{POINT, StreamSummary};
use super::inspection::Inspection;
use crate::error::Result;
use crate::format::input::Input;
use crate::format::kind::Kind;
use crate::format::log::tables::IMU;
use crate::format::read::{open_profiles, read_trajectory};
use crate::sensor::{FixQuality, Observations};

pub(super) fn inspect_profiles(input: &Input, report: &mut Inspection) -> Result<()> {
    let mut reader = open_profiles(input)?;
    let mut chunk = Vec::new();
    let mut summary = StreamSummary::of_columns(&POINT);
    while reader.next_chunk(&mut chunk)? {
        for point in &chunk {
            let p = &point.position_m;
            summary.add(point.time_s, [p.x, p.y, p.z, f64::from(point.intensity)]);
        }
    }
    summary.report(report)
}

pub(super) fn inspect_poses(input: &Input, report: &mut Inspection) -> Result<()> {
    let mut summary = StreamSummary::of_columns(&POINT[..3]);
    for pose in read_trajectory(input)? {
        let position = pose.world_from_body.translation_m;
        summary.add(pose.time_s, position.iter().copied());
    }
    summary.report(report)
}

pub(super) fn inspect_imu(input: &Input, kind: &Kind) -> Option<Result<StreamSummary>> {
    kind.imu.map(|read| {
        let mut summary = StreamSummary::of_columns(&IMU.needed[1..]);
        for sample in read(input)? {
            let (gyro, accel) = (sample.gyro_rad_s, sample.accel_m_s2);
            summary.add(sample.time_s, gyro.iter().chain(accel.iter()).copied());
        }
        Ok(summary)
    })
}

pub(super) fn inspect_heading(input: &Input, kind: &Kind) -> Option<Result<StreamSummary>> {
    kind.heading.map(|read| {
        let mut summary = StreamSummary::of_columns(&["heading_deg", "pitch_deg"]);
        for fix in read(input)? {
            let pitch_deg = fix.pitch_rad.map_or(f64::NAN, f64::to_degrees);
            summary.add(fix.time_s, [fix.heading_rad.to_degrees(), pitch_deg]);
        }
        Ok(summary)
    })
}

pub(super) fn inspect_geographic(input: &Input, kind: &Kind) -> Option<Result<StreamSummary>> {
    kind.geographic.map(|read| {
        let mut summary = StreamSummary::of_columns(&["latitude_deg", "longitude_deg", "height_m"]);
        let mut qualities = Vec::new();
        for fix in read(input)? {
            let [latitude, longitude] = [fix.latitude_rad, fix.longitude_rad].map(f64::to_degrees);
            summary.add(fix.time_s, [latitude, longitude, fix.height_m]);
            qualities.extend(fix.quality);
        }
        if !qualities.is_empty() {
            let counts = FixQuality::counts(qualities.iter().copied());
            input.remark(format!("solutions of the receiver: {counts}"));
        }
        Ok(summary)
    })
}

pub(super) fn inspect_geographic_poses(
    input: &Input,
    kind: &Kind,
) -> Option<Result<StreamSummary>> {
    kind.geographic_poses.map(|read| {
        let columns = [
            "latitude_deg",
            "longitude_deg",
            "height_m",
            "roll_deg",
            "pitch_deg",
            "heading_deg",
        ];
        let mut summary = StreamSummary::of_columns(&columns);
        for pose in read(input)? {
            let angles = [pose.angles.roll, pose.angles.pitch, pose.angles.heading];
            let [latitude, longitude] =
                [pose.latitude_rad, pose.longitude_rad].map(f64::to_degrees);
            let angles = angles.map(f64::to_degrees);
            let place = [latitude, longitude, pose.height_m];
            summary.add(pose.time_s, place.into_iter().chain(angles));
        }
        Ok(summary)
    })
}

pub(super) fn inspect_positions(input: &Input, kind: &Kind) -> Option<Result<StreamSummary>> {
    kind.positions.map(|read| {
        let mut summary = StreamSummary::of_columns(&["east_m", "north_m", "up_m"]);
        for fix in read(input, &Observations::AsFound)?.fixes {
            summary.add(fix.time_s, fix.position_m.iter().copied());
        }
        Ok(summary)
    })
}
