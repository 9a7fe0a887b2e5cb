//! Splits received bytes into lines of bounded length.

/// Longest line of a GeoCOM message, bytes. A full measurement with 15 decimals has about 200.
pub const LONGEST_LINE: usize = 1024;

/// Splits received bytes into lines, in bounded memory for any input.
#[derive(Debug, Default)]
pub struct Lines {
    line: Vec<u8>,
    is_skipping: bool,
    /// Bytes of lines that were skipped because they were longer than [`LONGEST_LINE`].
    pub skipped_bytes: u64,
    /// Lines that were longer than [`LONGEST_LINE`].
    pub skipped_lines: u64,
}

impl Lines {
    /// Takes bytes until a line is complete; returns the line without its terminator, and the number of
    /// bytes taken. CR or LF ends a line; empty lines are skipped.
    pub fn take(&mut self, bytes: &[u8]) -> (Option<Vec<u8>>, usize) {
        for (i, &byte) in bytes.iter().enumerate() {
            if byte == b'\r' || byte == b'\n' {
                let line = std::mem::take(&mut self.line);
                let was_skipping = std::mem::take(&mut self.is_skipping);
                if !was_skipping && !line.is_empty() {
                    return (Some(line), i + 1);
                }
            } else {
                self.push(byte);
            }
        }
        (None, bytes.len())
    }

    fn push(&mut self, byte: u8) {
        if self.is_skipping {
            self.skipped_bytes += 1;
        } else if self.line.len() == LONGEST_LINE {
            self.is_skipping = true;
            self.skipped_lines += 1;
            self.skipped_bytes += 1 + self.line.len() as u64;
            self.line.clear();
        } else {
            self.line.push(byte);
        }
    }

    /// Drops an incomplete line.
    pub fn clear(&mut self) {
        self.line.clear();
        self.is_skipping = false;
    }
}
