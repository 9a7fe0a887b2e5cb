//! Remote procedures by name and number.

use std::fmt;

macro_rules! procedures {
    ($($name:ident $leica:literal $number:literal $does:literal,)*) => {
        /// A remote procedure of the instrument.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Procedure {
            $(#[doc = $does] $name = $number,)*
        }

        impl Procedure {
            /// All procedures of this table.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// The manufacturer's name.
            pub fn name(self) -> &'static str {
                match self { $(Self::$name => $leica,)* }
            }

            /// The procedure with this number.
            pub fn from_number(number: u16) -> Option<Self> {
                match number { $($number => Some(Self::$name),)* _ => None }
            }
        }
    };
}

procedures! {
    Null "COM_NullProc" 0 "Does nothing: tests the connection.",
    SetDecimals "COM_SetDoublePrecision" 107 "Sets the number of decimals in replies.",
    GetDecimals "COM_GetDoublePrecision" 108 "The number of decimals in replies.",
    GetGeoComVersion "COM_GetSWVersion" 110 "Version of GeoCOM.",
    GetFirmware "CSV_GetSWVersion" 5034 "Version of the firmware.",
    GetSerialNumber "CSV_GetInstrumentNo" 5003 "Serial number.",
    GetName "CSV_GetInstrumentName" 5004 "Name of the instrument.",
    CheckPower "CSV_CheckPower" 5039 "Charge of the battery and source of power.",
    ReadLockStatus "MOT_ReadLockStatus" 6021 "Whether the instrument follows the prism.",
    LockIn "AUT_LockIn" 9013 "Starts to follow the prism.",
    FineAdjust "AUT_FineAdjust" 9037 "Points at the prism; searches in a window if needed.",
    PowerSearchNext "AUT_PS_SearchNext" 9051 "Searches the full circle for the next prism.",
    DoMeasure "TMC_DoMeasure" 2008 "Starts or stops measuring distances.",
    SetEdmMode "TMC_SetEdmMode" 2020 "Sets the mode of the distance meter.",
    GetEdmMode "TMC_GetEdmMode" 2021 "The mode of the distance meter.",
    GetCoordinate "TMC_GetCoordinate" 2082 "Coordinates of the prism.",
    GetAngle "TMC_GetAngle5" 2107 "Angles only.",
    GetSimpleMeas "TMC_GetSimpleMea" 2108 "Angles and slope distance.",
    QuickDist "TMC_QuickDist" 2117 "Starts tracking, waits for a distance; angles and distance.",
    GetFullMeas "TMC_GetFullMeas" 2167 "Angles, inclination, slope distance and its time.",
    SetPrismType "BAP_SetPrismType" 17008 "Sets the type of the prism.",
    GetPrismType "BAP_GetPrismType" 17009 "The type of the prism.",
    GetMeasProgram "BAP_GetMeasPrg" 17018 "The measurement program.",
    SetMeasProgram "BAP_SetMeasPrg" 17019 "Sets the measurement program.",
    SetLockState "AUS_SetUserLockState" 18007 "Switches the lock mode.",
    GetLockState "AUS_GetUserLockState" 18008 "Whether the lock mode is on.",
}

impl Procedure {
    /// The number of the procedure.
    pub fn number(self) -> u16 {
        self as u16
    }
}

impl fmt::Display for Procedure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.name(), self.number())
    }
}
