//! Cuts received bytes into lines of bounded length.

/// A line longer than this is no GeoCOM message, bytes. A full measurement with 15 decimals has
/// about 200.
pub const LONGEST_LINE: usize = 1024;

/// Cuts received bytes into lines. Memory is bounded whatever is received.
#[derive(Debug, Default)]
pub struct Lines {
    line: Vec<u8>,
    is_skipping: bool,
    /// Bytes of lines that were longer than [`LONGEST_LINE`], and therefore skipped.
    pub skipped_bytes: u64,
    /// Lines that were longer than [`LONGEST_LINE`].
    pub skipped_lines: u64,
}

impl Lines {
    /// Takes bytes until a line is whole; returns the line without its terminator, and how many
    /// bytes were taken. CR or LF end a line; empty lines are passed over.
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

    /// Forgets a line that is not finished.
    pub fn clear(&mut self) {
        self.line.clear();
        self.is_skipping = false;
    }
}
