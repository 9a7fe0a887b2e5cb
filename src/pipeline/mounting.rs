//! `mounting.csv`: the mountings by time.

use std::fmt::Write;

use crate::calibration::Calibration;
use crate::geometry::{BodyFromScanner, bent};
use crate::joint::MovedMounting;
use crate::sensor::PoseRecord;

const HEADER: &str = "time_s,scanner,x_m,y_m,z_m,qx,qy,qz,qw,sigma_x_m,sigma_y_m,sigma_z_m,\
                      sigma_rx_deg,sigma_ry_deg,sigma_rz_deg\n";

/// The mounting of every scanner along a drive. Standard deviations are those of the offsets from the mean, in body
/// axes; if mountings are rigid, those of the mounting, at the first and the last pose.
pub fn table(calibration: &Calibration, moved: &[MovedMounting], poses: &[PoseRecord]) -> String {
    let mut text = HEADER.to_owned();
    for (scanner, mounting) in calibration.mountings.iter().enumerate() {
        let mean = &mounting.body_from_scanner;
        let name = mounting.name.as_str();
        if let Some(moved) = moved.get(scanner) {
            let offsets = moved.offsets.samples().zip(moved.sigmas.samples());
            for ((time_s, offset), (_, sigma)) in offsets {
                line(&mut text, time_s, name, &bent(mean, offset), sigma);
            }
            continue;
        }
        let sigma = std::array::from_fn(|i| {
            let place = 6 * scanner + (i + 3) % 6;
            let covariance = calibration.covariance.as_ref();
            covariance.map_or(f64::NAN, |all| all[(place, place)].sqrt())
        });
        for pose in poses.first().into_iter().chain(poses.last()) {
            line(&mut text, pose.time_s, name, mean, &sigma);
        }
    }
    text
}

fn line(text: &mut String, time_s: f64, name: &str, mounting: &BodyFromScanner, sigma: &[f64; 6]) {
    let (t, q) = (mounting.translation_m, mounting.rotation.coords);
    let [rx, ry, rz, x, y, z] = sigma;
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{time_s:.3},{name},{:.7},{:.7},{:.7},{:.10},{:.10},{:.10},{:.10},{x:.7},{y:.7},{z:.7},{:.6},{:.6},{:.6}",
        t.x,
        t.y,
        t.z,
        q.x,
        q.y,
        q.z,
        q.w,
        rx.to_degrees(),
        ry.to_degrees(),
        rz.to_degrees()
    );
}
