//! Whole lines from bytes that arrive in pieces.

/// Joins lines from the pieces in which they arrive. Incomplete lines are dropped, because a number that is cut off is
/// wrong.
#[derive(Debug, Default)]
pub struct WholeLines {
    /// The beginning of a line whose end has not arrived.
    begun: Vec<u8>,
    /// Whether the beginning of the current line is missing.
    is_cut: bool,
}

impl WholeLines {
    /// Call this if bytes may be missing before the next ones. Drops the beginning of the current line and, if the next
    /// bytes may begin in the middle of a line (`is_cut`), later the bytes up to its end. Returns the number of bytes
    /// dropped now.
    pub fn interrupt(&mut self, is_cut: bool) -> u64 {
        self.is_cut = is_cut;
        std::mem::take(&mut self.begun).len() as u64
    }

    /// Returns the lines that these bytes complete, with their line ends, and the number of bytes dropped because the
    /// beginning of their line is missing. A mere line end is none of them: nothing is lost with it.
    pub fn take(&mut self, bytes: &[u8]) -> (Vec<u8>, u64) {
        let mut dropped = 0;
        if self.is_cut {
            let end = bytes.iter().position(|byte| *byte == b'\n');
            self.is_cut = end.is_none();
            dropped = end.map_or(bytes.len(), |at| at + 1);
        }
        let is_blank = bytes[..dropped].trim_ascii().is_empty();
        let bytes = &bytes[dropped..];
        let end = bytes.iter().rposition(|byte| *byte == b'\n');
        let (ended, rest) = bytes.split_at(end.map_or(0, |at| at + 1));
        let mut lines = Vec::new();
        if !ended.is_empty() {
            lines = std::mem::take(&mut self.begun);
            lines.extend_from_slice(ended);
        }
        self.begun.extend_from_slice(rest);
        (lines, if is_blank { 0 } else { dropped as u64 })
    }

    /// The beginning of the line whose end has not arrived.
    pub fn begun(&self) -> &[u8] {
        &self.begun
    }

    /// Returns the beginning of the current line as if it were a whole line, because the line is too long.
    pub fn end_line(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.begun)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incomplete_lines_are_dropped() {
        let mut lines = WholeLines::default();
        assert_eq!(lines.interrupt(true), 0);
        assert_eq!(lines.take(b"3"), (Vec::new(), 1));
        assert_eq!(lines.take(b".4\r\n5.6\r\n7"), (b"5.6\r\n".to_vec(), 4));
        assert_eq!(lines.begun(), b"7");
        assert_eq!(lines.take(b"\r\n8"), (b"7\r\n".to_vec(), 0));
        assert_eq!(lines.interrupt(false), 1);
        assert_eq!(lines.take(b"9\n\n10"), (b"9\n\n".to_vec(), 0));
        assert_eq!(lines.end_line(), b"10");
        lines.interrupt(true);
        assert_eq!(lines.take(b"\r\n11\n"), (b"11\n".to_vec(), 0));
    }
}
