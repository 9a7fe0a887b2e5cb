//! Return codes, with the numbers of the manual's appendix as `geocompy` 1.0.0 lists them.

use std::fmt;

/// The return code of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ReturnCode(
    /// The number.
    pub u16,
);

macro_rules! codes {
    ($($number:literal $name:ident $meaning:literal,)*) => {
        impl ReturnCode {
            $(#[doc = $meaning] pub const $name: Self = Self($number);)*

            /// All codes of this table.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// The manufacturer's name without its prefix `GRC_`, if the code is in this table.
            pub fn name(self) -> Option<&'static str> {
                match self.0 { $($number => Some(stringify!($name)),)* _ => None }
            }

            /// The meaning of the code, if it is in this table.
            pub fn meaning(self) -> Option<&'static str> {
                match self.0 { $($number => Some($meaning),)* _ => None }
            }
        }
    };
}

codes! {
    0 OK "done",
    1 UNDEFINED "unknown error",
    2 IVPARAM "a parameter is not allowed",
    3 IVRESULT "the result is not valid",
    4 FATAL "fatal error of the instrument",
    5 NOT_IMPL "not available on this instrument",
    6 TIME_OUT "the function took too long",
    7 SET_INCOMPL "settings are missing",
    8 ABORT "the function was aborted",
    9 NOMEMORY "the instrument has no memory left",
    10 NOTINIT "a part of the instrument is not initialised",
    12 SHUT_DOWN "a part of the instrument is switched off",
    13 SYSBUSY "the instrument is busy with something else",
    14 HWFAILURE "hardware failure",
    15 ABORT_APPL "aborted at the instrument",
    16 LOW_POWER "too little power",
    17 IVVERSION "wrong version of a file",
    18 BATT_EMPTY "the battery is empty",
    21 OUT_OF_TEMP "the instrument is too cold or too hot",
    22 INSTRUMENT_TILT "the instrument is tilted too much",
    25 SLEEP_MODE "the instrument went to sleep",
    26 NOTOK "not done",
    27 NA "not available",
    29 STOPPED "the system was stopped",
    257 ANG_ERROR "angles and inclination are not valid",
    512 ATA_NOT_READY "the target recognition is not ready",
    517 ATA_NO_TARGETS "no prism seen",
    514 ATA_SEVERAL_TARGETS "several prisms seen",
    770 EDM_NOSIGNAL "no signal of the distance meter",
    775 EDM_TIMEOUT "the distance meter took too long",
    778 EDM_DEV_NOT_INSTALLED "no distance meter",
    786 EDM_BUSY "the distance meter is busy",
    1283 TMC_NO_FULL_CORRECTION "measured, but not all corrections applied",
    1284 TMC_ACCURACY_GUARANTEE "measured, accuracy not guaranteed",
    1285 TMC_ANGLE_OK "angles valid, no distance",
    1288 TMC_ANGLE_NO_FULL_CORRECTION "angles without all corrections, no distance",
    1289 TMC_ANGLE_ACCURACY_GUARANTEE "angles of no guaranteed accuracy, no distance",
    1290 TMC_ANGLE_ERROR "no angles",
    1291 TMC_DIST_PPM "wrong ppm or prism constant in the distance meter",
    1292 TMC_DIST_ERROR "no distance, for example because no prism is aimed at",
    1293 TMC_BUSY "measuring is busy",
    1294 TMC_SIGNAL_ERROR "no signal of the distance meter",
    1380 TMC_OLD_PLANE "the inclination is too old",
    1381 TMC_NO_PLANE "no inclination to correct with",
    1383 TMC_INCLINE_ACC "accuracy of the inclination not guaranteed",
    1792 MOT_UNREADY "the motors are not ready",
    1793 MOT_BUSY "the motors are busy",
    1795 MOT_NOT_CONFIG "the motors are in another mode or busy",
    1799 MOT_NOT_LOCK "the motors do not follow a prism",
    3072 COM_ERO "a long function started",
    3073 COM_CANT_ENCODE "a request cannot be written",
    3074 COM_CANT_DECODE "a reply cannot be read",
    3075 COM_CANT_SEND "sending failed",
    3076 COM_CANT_RECV "receiving failed",
    3077 COM_TIMEDOUT "no reply in time",
    3078 COM_WRONG_FORMAT "wrong format of a message",
    3079 COM_VER_MISMATCH "versions do not match",
    3080 COM_CANT_DECODE_REQ "the instrument cannot read the parameters",
    3081 COM_PROC_UNAVAIL "the instrument does not know the procedure",
    3082 COM_CANT_ENCODE_REP "the instrument cannot write the reply",
    3083 COM_SYSTEM_ERR "system error",
    3085 COM_FAILED "communication failed",
    3087 COM_INTR "interrupted",
    3093 COM_TR_ID_MISMATCH "wrong transaction number",
    3094 COM_NOT_GEOCOM "not a GeoCOM message",
    3100 COM_OVERRUN "a message was too long",
    3101 COM_SRVR_RX_CHECKSUM_ERROR "the instrument received a wrong checksum",
    3102 COM_CLNT_RX_CHECKSUM_ERROR "the reply has a wrong checksum",
    3105 COM_NO_PARTNER "no instrument",
    3107 COM_CONS_REQ "a request came before the reply to the last one",
    3108 COM_SRVR_IS_SLEEPING "the instrument sleeps",
    3109 COM_SRVR_IS_OFF "the instrument is switched off",
    3110 COM_NO_CHECKSUM "the instrument has no checksums in the ASCII protocol",
    8704 AUT_TIMEOUT "the position was not reached in time",
    8706 AUT_ANGLE_ERROR "the angle measurement failed",
    8707 AUT_MOTOR_ERROR "the motors failed",
    8708 AUT_INCACC "the position was not reached exactly",
    8709 AUT_DEV_ERROR "the deviation measurement failed",
    8710 AUT_NO_TARGET "no prism found",
    8711 AUT_MULTIPLE_TARGETS "several prisms found",
    8712 AUT_BAD_ENVIRONMENT "bad light or air",
    8713 AUT_DETECTOR_ERROR "the target recognition failed",
    8714 AUT_NOT_ENABLED "the target recognition or lock mode is off",
    8716 AUT_ACCURACY "the prism was not aimed at exactly",
    8717 AUT_DIST_STARTED "a distance measurement started",
    8718 AUT_SUPPLY_TOO_HIGH "the external voltage is too high",
    8719 AUT_SUPPLY_TOO_LOW "the voltage is too low",
    8720 AUT_NO_WORKING_AREA "no working area is set",
    8722 AUT_NO_DATA "no data",
    8723 AUT_SIDECOVER_ERR "the side cover is open",
    8725 AUT_NO_LOCK "lock mode is not allowed",
    9217 BAP_CHANGE_ALL_TO_DIST "the command was changed to a distance measurement",
}

impl ReturnCode {
    /// Whether the procedure does not exist on the instrument.
    pub fn is_unknown(self) -> bool {
        matches!(self, Self::COM_PROC_UNAVAIL | Self::NOT_IMPL | Self::NA)
    }

    /// Whether the same request may succeed a moment later.
    pub fn is_busy(self) -> bool {
        matches!(
            self,
            Self::SYSBUSY | Self::TMC_BUSY | Self::EDM_BUSY | Self::MOT_BUSY
        ) || matches!(
            self,
            Self::COM_TIMEDOUT | Self::COM_INTR | Self::COM_CONS_REQ | Self::COM_SRVR_IS_SLEEPING
        )
    }

    /// Whether the request may have been damaged in transmission.
    pub fn is_damage(self) -> bool {
        matches!(
            self,
            Self::COM_SRVR_RX_CHECKSUM_ERROR | Self::COM_CANT_DECODE_REQ | Self::COM_NOT_GEOCOM
        ) || matches!(
            self,
            Self::COM_WRONG_FORMAT | Self::COM_OVERRUN | Self::COM_CANT_RECV
        )
    }
}

impl fmt::Display for ReturnCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.name(), self.meaning()) {
            (Some(name), Some(meaning)) => write!(f, "{} {name} ({meaning})", self.0),
            _ => write!(f, "{} (unknown code)", self.0),
        }
    }
}
