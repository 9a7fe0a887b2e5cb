//! The manufacturer's names of messages.

use super::message::Kind;

/// Messages of class 0, without the prefix `SBG_ECOM_LOG_`.
const NAMES: [(u8, &str); 42] = [
    (1, "STATUS"),
    (2, "UTC_TIME"),
    (3, "IMU_DATA"),
    (4, "MAG"),
    (5, "MAG_CALIB"),
    (6, "EKF_EULER"),
    (7, "EKF_QUAT"),
    (8, "EKF_NAV"),
    (9, "SHIP_MOTION"),
    (13, "GPS1_VEL"),
    (14, "GPS1_POS"),
    (15, "GPS1_HDT"),
    (16, "GPS2_VEL"),
    (17, "GPS2_POS"),
    (18, "GPS2_HDT"),
    (19, "ODO_VEL"),
    (24, "EVENT_A"),
    (25, "EVENT_B"),
    (26, "EVENT_C"),
    (27, "EVENT_D"),
    (28, "EVENT_E"),
    (29, "DVL_BOTTOM_TRACK"),
    (30, "DVL_WATER_TRACK"),
    (31, "GPS1_RAW"),
    (32, "SHIP_MOTION_HP"),
    (36, "AIR_DATA"),
    (37, "USBL"),
    (38, "GPS2_RAW"),
    (44, "IMU_SHORT"),
    (45, "EVENT_OUT_A"),
    (46, "EVENT_OUT_B"),
    (47, "DEPTH"),
    (48, "DIAG"),
    (49, "RTCM_RAW"),
    (50, "GPS1_SAT"),
    (51, "GPS2_SAT"),
    (52, "EKF_ROT_ACCEL_BODY"),
    (53, "EKF_ROT_ACCEL_NED"),
    (54, "EKF_VEL_BODY"),
    (55, "SESSION_INFO"),
    (56, "EKF_DEBUG"),
    (57, "PTP_STATUS"),
];

/// The name of a kind of message, or its numbers.
pub(super) fn name((class, message): Kind) -> String {
    /// Pages of large frames.
    const LARGE: u8 = 0x80;
    let known = NAMES.iter().find(|(id, _)| *id == message);
    match (class, known) {
        (0, Some((_, name))) => (*name).to_owned(),
        (1, _) if message == 0 => "FAST_IMU_DATA".to_owned(),
        (LARGE.., _) => format!("page of class {} message {message}", class - LARGE),
        _ => format!("class {class} message {message}"),
    }
}
