//! Sends one request at a time and waits for its reply, over a link that may lose, damage or delay messages.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::codec::{Malformed, Reply, Request, Value};
use super::codes::ReturnCode;
use super::lines::Lines;
use super::procedure::Procedure;
use crate::error::{Error, Result};

/// A connection to an instrument: a serial port, or a TCP stream, which should send without delay
/// (`set_nodelay`).
pub trait Link: Read + Write {
    /// Sets the longest time that one read or write may take; it is never zero. A read that takes
    /// longer must end with [`ErrorKind::TimedOut`] or [`ErrorKind::WouldBlock`].
    ///
    /// # Errors
    /// If the port refuses.
    fn set_timeout(&mut self, timeout: Duration) -> io::Result<()>;
}

impl Link for TcpStream {
    fn set_timeout(&mut self, timeout: Duration) -> io::Result<()> {
        self.set_read_timeout(Some(timeout))?;
        self.set_write_timeout(Some(timeout))
    }
}

impl<L: Link + ?Sized> Link for Box<L> {
    fn set_timeout(&mut self, timeout: Duration) -> io::Result<()> {
        (**self).set_timeout(timeout)
    }
}

/// Counts of events on the link.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Requests sent, including repeated requests.
    pub requests: u64,
    /// Replies that belong to the last request.
    pub replies: u64,
    /// Requests repeated for any reason.
    pub asked_again: u64,
    /// Replies with a wrong checksum.
    pub wrong_checksums: u64,
    /// Lines that are not replies, replies without the requested values, and lines that are too long.
    pub garbled: u64,
    /// Bytes before a reply in its line, and bytes of lines that are too long.
    pub noise_bytes: u64,
    /// Replies to earlier requests, which are dropped because their time is unknown.
    pub late: u64,
    /// Requests without a reply in time.
    pub timeouts: u64,
    /// Replies that the instrument is busy.
    pub busy: u64,
    /// Replies that the request was damaged in transmission.
    pub damaged_requests: u64,
    /// Distances that the instrument sent again with newer angles, which are dropped.
    pub repeated_distances: u64,
    /// Times that the prism was lost.
    pub losses: u64,
    /// Times that the instrument was reconnected.
    pub reconnects: u64,
}

/// A reply and its times.
#[derive(Debug)]
pub(super) struct Answer<S> {
    pub reply: Reply,
    pub arrived: S,
    pub round_trip: Duration,
}

impl<S> Answer<S> {
    /// The code of the communication if that failed, otherwise the code of the procedure.
    pub fn code(&self) -> ReturnCode {
        match self.reply.communication {
            ReturnCode::OK => self.reply.code,
            failed => failed,
        }
    }
}

/// The result of waiting for a reply.
enum ReplyOutcome<S> {
    Reply(Answer<S>),
    AskAgain,
}

/// Time to keep listening after a line that is not a reply: the reply may still come, or that line was
/// the damaged reply. A full measurement takes 0.2 s at 9600 baud.
const AFTER_NOISE: Duration = Duration::from_millis(300);
/// Pause before a busy instrument is asked again.
const AFTER_BUSY: Duration = Duration::from_millis(50);
/// Largest transaction number. Numbers count from 1, and 0 stands for a request without a number.
const LAST_TRANSACTION: u16 = 32_767;
/// A request without a reply is given up after this many times the time-out.
const PATIENCE: u32 = 3;

pub(super) struct Channel<L, S> {
    link: L,
    port: String,
    now: Box<dyn FnMut() -> S + Send>,
    lines: Lines,
    received: Vec<u8>,
    transaction: u16,
    has_checksum: bool,
    /// Whether the link has ended, so that nothing can be sent any more.
    pub is_dead: bool,
    pub counters: Counters,
}

impl<L: Link, S> Channel<L, S> {
    pub fn new(link: L, port: &str, now: Box<dyn FnMut() -> S + Send>) -> Self {
        Self {
            link,
            port: port.to_owned(),
            now,
            lines: Lines::default(),
            received: Vec::new(),
            transaction: 0,
            has_checksum: false,
            is_dead: false,
            counters: Counters::default(),
        }
    }

    pub fn replace_link(&mut self, link: L) {
        self.link = link;
        self.lines.clear();
        self.received.clear();
        self.is_dead = false;
        self.counters.reconnects += 1;
    }

    pub fn set_checksum(&mut self, has_checksum: bool) {
        self.has_checksum = has_checksum;
    }

    pub fn port(&self) -> &str {
        &self.port
    }

    /// Repeats a request until a complete reply arrives that reports neither a busy instrument nor a
    /// damaged request.
    ///
    /// # Errors
    /// [`Error::Io`] if the link ended or no reply came in three times `timeout`. A call takes at most four
    /// times `timeout`.
    pub fn ask(
        &mut self,
        procedure: Procedure,
        parameters: &[Value],
        timeout: Duration,
    ) -> Result<Answer<S>> {
        let end = Instant::now() + timeout * PATIENCE;
        let mut last = None;
        for attempt in 0_u64.. {
            if attempt > 0 && Instant::now() >= end {
                break;
            }
            self.counters.asked_again += u64::from(attempt > 0);
            let ReplyOutcome::Reply(answer) =
                self.ask_once(procedure, parameters, attempt, timeout)?
            else {
                continue;
            };
            let code = answer.code();
            if code.is_damage() {
                self.counters.damaged_requests += 1;
            } else if code.is_busy() {
                self.counters.busy += 1;
                std::thread::sleep(AFTER_BUSY.min(timeout));
            } else {
                return Ok(answer);
            }
            last = Some(answer);
        }
        last.ok_or_else(|| {
            let seconds = (timeout * PATIENCE).as_secs_f64();
            let problem = format!("found no reply to {procedure} in {seconds} s, expected a reply");
            Error::io(&self.port, io::Error::new(ErrorKind::TimedOut, problem))
        })
    }

    fn ask_once(
        &mut self,
        procedure: Procedure,
        parameters: &[Value],
        attempt: u64,
        timeout: Duration,
    ) -> Result<ReplyOutcome<S>> {
        self.transaction = self.transaction % LAST_TRANSACTION + 1;
        let (number, checked) = (procedure.number(), self.has_checksum);
        let line = Request::line(number, self.transaction, parameters, checked);
        // A line feed clears the instrument's receive buffer. The first attempt has nothing to clear.
        let clear = if attempt > 0 { "\n" } else { "" };
        let message = format!("{clear}{line}\r\n");
        let sent = Instant::now();
        let written = (self.link.set_timeout(timeout))
            .and_then(|()| self.link.write_all(message.as_bytes()))
            .and_then(|()| self.link.flush());
        written.map_err(|source| self.dead(source))?;
        self.counters.requests += 1;
        self.listen(sent, timeout)
    }

    fn listen(&mut self, sent: Instant, timeout: Duration) -> Result<ReplyOutcome<S>> {
        let mut deadline = sent + timeout;
        let mut is_noisy = false;
        loop {
            while let Some(line) = self.next_line() {
                let start = line.windows(5).rposition(|bytes| bytes == b"%R1P,");
                match start.map(|start| (start, Reply::parse(&line[start..]))) {
                    Some((start, Ok(reply))) if self.is_awaited(&reply) => {
                        self.counters.noise_bytes += start as u64;
                        self.counters.replies += 1;
                        return Ok(ReplyOutcome::Reply(Answer {
                            reply,
                            arrived: (self.now)(),
                            round_trip: sent.elapsed(),
                        }));
                    }
                    Some((_, Ok(reply))) if self.has_checksum && !reply.has_checksum => {
                        self.counters.garbled += 1;
                        return Ok(ReplyOutcome::AskAgain);
                    }
                    Some((_, Ok(_))) => self.counters.late += 1,
                    Some((_, Err(Malformed::Checksum))) => {
                        self.counters.wrong_checksums += 1;
                        return Ok(ReplyOutcome::AskAgain);
                    }
                    Some((_, Err(Malformed::Syntax))) => {
                        self.counters.garbled += 1;
                        return Ok(ReplyOutcome::AskAgain);
                    }
                    None => {
                        self.counters.garbled += 1;
                        is_noisy = true;
                        deadline = deadline.min(Instant::now() + AFTER_NOISE);
                    }
                }
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                self.counters.timeouts += u64::from(!is_noisy);
                // The rest of a broken line would damage the next reply.
                self.lines.clear();
                return Ok(ReplyOutcome::AskAgain);
            }
            self.receive(left)?;
        }
    }

    /// Whether a reply belongs to the last request. A damaged request may have lost its number.
    fn is_awaited(&self, reply: &Reply) -> bool {
        let is_own = reply.transaction == self.transaction;
        let is_unnumbered = reply.transaction == 0 && reply.communication.is_damage();
        let is_checked = reply.has_checksum || !self.has_checksum;
        // An error of the communication need not have a checksum.
        let is_error = reply.communication != ReturnCode::OK;
        (is_own || is_unnumbered) && (is_checked || is_error)
    }

    fn next_line(&mut self) -> Option<Vec<u8>> {
        let before = (self.lines.skipped_lines, self.lines.skipped_bytes);
        let (line, taken) = self.lines.take(&self.received);
        self.received.drain(..taken);
        self.counters.garbled += self.lines.skipped_lines - before.0;
        self.counters.noise_bytes += self.lines.skipped_bytes - before.1;
        line
    }

    fn receive(&mut self, longest: Duration) -> Result<()> {
        let mut bytes = [0; 4096];
        let timeout = longest.max(Duration::from_millis(1));
        let read = (self.link.set_timeout(timeout)).and_then(|()| self.link.read(&mut bytes));
        match read {
            Ok(0) => {
                let problem = "found the end of the connection, expected a reply";
                Err(self.dead(io::Error::new(ErrorKind::UnexpectedEof, problem)))
            }
            Ok(count) => {
                self.received
                    .extend_from_slice(bytes.get(..count).unwrap_or_default());
                Ok(())
            }
            Err(source) => match source.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(()),
                _ => Err(self.dead(source)),
            },
        }
    }

    fn dead(&mut self, source: io::Error) -> Error {
        self.is_dead = true;
        Error::io(&self.port, source)
    }
}
