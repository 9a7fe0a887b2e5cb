//! Rests, found block by block during the drive.

use crate::trajectory::rest::{REST_BLOCK_S, REST_BLOCKS, Rest, checked, still};
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::streams::Streams;

/// A rest is checked over at most this many blocks: they show a drift, and a longer rest costs no
/// more.
const MAX_BLOCKS: usize = 8;

/// How far the drive has been examined.
#[derive(Debug, Clone)]
pub struct RestWatch {
    next_s: f64,
    run: usize,
}

impl RestWatch {
    pub fn new(start_s: f64) -> Self {
        Self {
            next_s: start_s,
            run: 0,
        }
    }

    /// Looks at the next block that ends by `until_s`: the rest it ends, which may be longer than
    /// the block. `None` where no more blocks can be looked at.
    pub fn seen(
        &mut self,
        streams: &Streams,
        settings: &TrajectorySettings,
        until_s: f64,
    ) -> Option<Rest> {
        while self.next_s + REST_BLOCK_S <= until_s {
            let from_s = self.next_s;
            self.next_s += REST_BLOCK_S;
            if !still(streams, settings, from_s) {
                self.run = 0;
                continue;
            }
            self.run = (self.run + 1).min(MAX_BLOCKS);
            if self.run >= REST_BLOCKS {
                let begun_s = self.next_s - self.run as f64 * REST_BLOCK_S;
                let rest = checked(streams, settings, begun_s, self.next_s);
                if rest.is_some() {
                    return rest;
                }
            }
        }
        None
    }
}
