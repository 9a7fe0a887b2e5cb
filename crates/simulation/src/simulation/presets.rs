//! The scenarios that can be chosen by name.

use super::field::{DriveSettings, Pass};
use super::scenario::Scenario;

impl Scenario {
    /// The paper's field and three drives, with rates reduced so that the simulation takes seconds.
    pub fn demo() -> Self {
        Self::default()
    }

    /// The paper's rates: gigabytes of profiles.
    pub fn full() -> Self {
        let mut scenario = Self {
            name: "full".into(),
            ..Self::default()
        };
        scenario.profiles.rate_hz = 200.0;
        scenario.profiles.width = 1920;
        scenario.reference.board_spacing_m = 0.001;
        scenario.reference.soil_spacing_m = 0.001;
        scenario
    }

    /// The demo's robot on slightly cloddy soil without boards: one drive of parallel passes, back
    /// and forth, whose scans overlap so that most of the soil is seen in both directions.
    pub fn plain() -> Self {
        /// East of the two ends of each pass, metres.
        const EAST_M: [f64; 2] = [1.25, 6.25];
        /// Distance between neighbouring passes, metres.
        const APART_M: f64 = 0.6;
        let pass = |k: u8| {
            let north = 1.5 + f64::from(k) * APART_M;
            let [from_m, to_m] = EAST_M.map(|east| [east, north]);
            if k.is_multiple_of(2) {
                Pass::Line { from_m, to_m }
            } else {
                Pass::Line {
                    from_m: to_m,
                    to_m: from_m,
                }
            }
        };
        let mut scenario = Self {
            name: "plain".into(),
            boards: Vec::new(),
            drives: vec![DriveSettings {
                passes: (0..6).map(pass).collect(),
            }],
            ..Self::default()
        };
        scenario.soil.clod_height_m = 0.02;
        scenario.soil.clod_cover = 0.1;
        scenario
    }
}
