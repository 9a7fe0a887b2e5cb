//! Rests, found block by block during the drive.

use crate::trajectory::rest::{REST_BLOCK_S, REST_BLOCKS, Rest, checked_rest, is_still};
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::streams::Streams;

/// A rest is checked over at most this many blocks: enough to show a drift, and a longer rest then costs
/// no more.
const MAX_BLOCKS: usize = 8;

/// How far the drive has been examined.
#[derive(Debug, Clone)]
pub struct RestWatch {
    /// Start of the next block, seconds.
    next_s: f64,
    /// Still blocks in a row before it.
    still_blocks: usize,
}

impl RestWatch {
    pub fn new(start_s: f64) -> Self {
        Self {
            next_s: start_s,
            still_blocks: 0,
        }
    }

    /// Examines the next blocks that end by `until_s` up to the first that ends a rest, and returns that
    /// rest, which may be longer than the block. `None` where no block is left.
    pub fn next_rest(
        &mut self,
        streams: &Streams,
        settings: &TrajectorySettings,
        until_s: f64,
    ) -> Option<Rest> {
        while self.next_s + REST_BLOCK_S <= until_s {
            let from_s = self.next_s;
            self.next_s += REST_BLOCK_S;
            if !is_still(streams, settings, from_s) {
                self.still_blocks = 0;
                continue;
            }
            self.still_blocks = (self.still_blocks + 1).min(MAX_BLOCKS);
            if self.still_blocks >= REST_BLOCKS {
                let begun_s = self.next_s - self.still_blocks as f64 * REST_BLOCK_S;
                let rest = checked_rest(streams, settings, begun_s, self.next_s);
                if rest.is_some() {
                    return rest;
                }
            }
        }
        None
    }
}
