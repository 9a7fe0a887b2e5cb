//! What the messages hold.

use super::message::{Message, gps_s};
use crate::format::left_out::{DAMAGED, NOT_FIXED};
use crate::format::text::civil::unix_from_gps_s;
use crate::geometry::Vec3;
use crate::sensor::{
    FixQuality, GeographicFix, GeographicPose, HeadingFix, NavigationAngles, NavigationSigma,
};

/// The reason of a message that the receiver marks as not measured.
pub(super) const WITHOUT_SOLUTION: &str = "without a solution";

/// A record, or the reason why there is none.
type Parsed<T> = Result<T, &'static str>;

/// Finite numbers of the fields from `first` on.
fn numbers<const N: usize>(message: &Message<'_>, first: usize) -> Parsed<[f64; N]> {
    let mut values = [0.0_f64; N];
    for (value, at) in values.iter_mut().zip(first..) {
        let field = message.fields.get(at).and_then(|text| text.parse().ok());
        *value = field.filter(|x: &f64| x.is_finite()).ok_or(DAMAGED)?;
    }
    Ok(values)
}

/// The quality of a position of this type; `None` for positions that were not measured.
fn quality(kind: &str) -> Option<FixQuality> {
    Some(match kind {
        "NONE" | "FIXEDPOS" | "FIXEDHEIGHT" | "PROPAGATED" => return None,
        "L1_INT" | "NARROW_INT" | "INS_RTKFIXED" => FixQuality::Fixed,
        // Ambiguities of the wide lane leave decimetres.
        "WIDE_INT" | "L1_FLOAT" | "NARROW_FLOAT" | "IONOFREE_FLOAT" | "FLOATCONV" | "WIDELANE"
        | "NARROWLANE" | "INS_RTKFLOAT" | "PPP" | "PPP_CONVERGING" | "INS_PPP"
        | "INS_PPP_CONVERGING" => FixQuality::Float,
        "PSRDIFF"
        | "WAAS"
        | "SBAS"
        | "CDGPS"
        | "PPP_BASIC"
        | "PPP_BASIC_CONVERGING"
        | "INS_PSRDIFF"
        | "INS_SBAS"
        | "INS_PPP_BASIC"
        | "INS_PPP_BASIC_CONVERGING" => FixQuality::Differential,
        _ => FixQuality::Single,
    })
}

/// The quality of the solution whose status and type are the first fields.
fn solution(message: &Message<'_>) -> Parsed<FixQuality> {
    let [status, kind, ..] = message.fields[..] else {
        return Err(DAMAGED);
    };
    let quality = quality(kind).filter(|_| status == "SOL_COMPUTED");
    quality.ok_or(WITHOUT_SOLUTION)
}

/// `status, type, latitude, longitude, height, undulation, datum, standard deviations of latitude, longitude, height, …`
pub(super) fn position(message: &Message<'_>, time_s: f64) -> Parsed<GeographicFix> {
    let quality = solution(message)?;
    let [latitude, longitude, height_m, undulation_m] = numbers(message, 2)?;
    let [north, east, up] = numbers(message, 7)?;
    if latitude.abs() > 90.0 || longitude.abs() > 360.0 {
        return Err(DAMAGED);
    }
    let sigma_m = Vec3::new(east, north, up);
    Ok(GeographicFix {
        time_s,
        latitude_rad: latitude.to_radians(),
        longitude_rad: longitude.to_radians(),
        height_m: height_m + undulation_m,
        sigma_m: (sigma_m.min() > 0.0).then_some(sigma_m),
        quality: Some(quality),
    })
}

/// `status, type, length, heading, pitch, reserved, standard deviations of heading, pitch, …` of the line from the first
/// antenna to the second.
pub(super) fn heading(message: &Message<'_>, time_s: f64) -> Parsed<HeadingFix> {
    if solution(message)? != FixQuality::Fixed {
        return Err(NOT_FIXED);
    }
    let [heading, pitch, _, sigma, pitch_sigma] = numbers(message, 3)?;
    if !(0.0..=360.0).contains(&heading) || pitch.abs() > 90.0 {
        return Err(DAMAGED);
    }
    // Zero stands for an unknown standard deviation.
    let known = |sigma: f64| (sigma > 0.0).then(|| sigma.to_radians());
    Ok(HeadingFix {
        time_s,
        heading_rad: heading.to_radians(),
        sigma_rad: known(sigma),
        pitch_rad: Some(pitch.to_radians()),
        pitch_sigma_rad: known(pitch_sigma),
    })
}

/// The pose of one of the INSPVA messages.
pub(super) fn pose(message: &Message<'_>, time_s: f64) -> Parsed<GeographicPose> {
    let pose = match message.name {
        "INSPVAXA" | "INSPVAXSA" => pose_with_sigma(message, time_s),
        _ => plain_pose(message),
    }?;
    pose.check().map_err(|_| DAMAGED)?;
    Ok(pose)
}

/// Whether an inertial solution with this status gives poses.
fn check_status(status: Option<&&str>) -> Parsed<()> {
    match status {
        Some(
            &"INS_SOLUTION_GOOD"
            | &"INS_SOLUTION_FREE"
            | &"INS_ALIGNMENT_COMPLETE"
            | &"INS_HIGH_VARIANCE",
        ) => Ok(()),
        Some(_) => Err(WITHOUT_SOLUTION),
        None => Err(DAMAGED),
    }
}

/// `status, type, latitude, longitude, height, undulation, velocity north, east, up, roll, pitch, azimuth, standard
/// deviations of latitude, longitude, height, of the velocity, of roll, pitch, azimuth, …`
fn pose_with_sigma(message: &Message<'_>, time_s: f64) -> Parsed<GeographicPose> {
    check_status(message.fields.first())?;
    let [latitude, longitude, height_m, undulation_m] = numbers(message, 2)?;
    let [north, east, up] = numbers(message, 6)?;
    let angles = NavigationAngles::from_deg(numbers(message, 9)?);
    let [sigma_north, sigma_east, sigma_up] = numbers(message, 12)?;
    let sigma_deg: [f64; 3] = numbers(message, 18)?;
    let sigma = NavigationSigma {
        position_m: Vec3::new(sigma_east, sigma_north, sigma_up),
        angles: NavigationAngles::from_deg(sigma_deg),
    };
    // Zero stands for an unknown standard deviation.
    let is_known = sigma.position_m.min() > 0.0 && sigma_deg.iter().all(|s| *s > 0.0);
    Ok(GeographicPose {
        time_s,
        latitude_rad: latitude.to_radians(),
        longitude_rad: longitude.to_radians(),
        height_m: height_m + undulation_m,
        angles,
        velocity_m_s: Some(Vec3::new(east, north, up)),
        sigma: is_known.then_some(sigma),
    })
}

/// `GPS week, its second, latitude, longitude, ellipsoidal height, velocity north, east, up, roll, pitch, azimuth, status`:
/// the time is finer than that of the header.
fn plain_pose(message: &Message<'_>) -> Parsed<GeographicPose> {
    check_status(message.fields.get(11))?;
    let [week, second, ..] = message.fields[..] else {
        return Err(DAMAGED);
    };
    let time_s = gps_s(week, second).map(unix_from_gps_s).ok_or(DAMAGED)?;
    let [latitude, longitude, height_m, north, east, up] = numbers(message, 2)?;
    Ok(GeographicPose {
        time_s,
        latitude_rad: latitude.to_radians(),
        longitude_rad: longitude.to_radians(),
        height_m,
        angles: NavigationAngles::from_deg(numbers(message, 8)?),
        velocity_m_s: Some(Vec3::new(east, north, up)),
        sigma: None,
    })
}
