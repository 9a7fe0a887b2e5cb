//! The unknowns of a chain, and their order within a step.

/// Unknowns of a node.
pub const NODE: usize = 9;
/// Unknowns that the steps of a segment share.
pub const SEGMENT: usize = 6;
/// The last node and segment together.
pub const TAIL: usize = NODE + SEGMENT;
/// Unknowns that a step touches: node i, node i + 1, segment.
pub const STEP: usize = 2 * NODE + SEGMENT;
/// Unknowns at a change of segment: old segment, node, new segment.
pub const CHANGE: usize = NODE + 2 * SEGMENT;

/// The segment of each step: the same as that of the step before, or the next one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ChainLayout {
    pub segment_of_step: Vec<u32>,
}

impl ChainLayout {
    pub fn steps(&self) -> usize {
        self.segment_of_step.len()
    }

    pub fn nodes(&self) -> usize {
        self.steps() + 1
    }

    pub fn segments(&self) -> usize {
        self.segment_of_step.last().map_or(0, |&k| k as usize + 1)
    }

    /// The segment of step `i`; for the step after the last, the newest one.
    pub fn segment(&self, i: usize) -> usize {
        let step = i.min(self.steps().saturating_sub(1));
        self.segment_of_step.get(step).map_or(0, |&k| k as usize)
    }

    /// Whether a segment begins at step `i`; the segment before it is that of step i − 1.
    pub fn changes_before(&self, i: usize) -> bool {
        i > 0 && self.segment_of_step[i] != self.segment_of_step[i - 1]
    }
}
