//! Plays a recording: servers that send what its sensors sent, when they sent it.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::clock::Clock;
use super::field::{Field, Kind};
use super::geocom::simulated::{Simulated, SimulatedSettings, TcpInstrument};
use super::place::Place;
use crate::error::{Error, Result};
use crate::format::{Pieces, RecordingClock, station_rows};

/// Before the first piece is sent, so that all links are open, seconds of ours.
const LEAD_S: f64 = 1.0;
/// Longest time without looking whether to stop.
const PATIENCE: Duration = Duration::from_millis(20);
/// Largest datagram.
const DATAGRAM: usize = 1400;

/// A recording that is played over sockets of this computer.
pub struct Player {
    field: Field,
    clock: Clock,
    stop: Arc<AtomicBool>,
    senders: Vec<JoinHandle<Result<()>>>,
    /// Live as long as the recording is played.
    _stations: Vec<TcpInstrument>,
    span_s: f64,
}

impl Player {
    /// Begins to play the recording in a folder, so many times as fast as it was made.
    ///
    /// # Errors
    /// A folder without `field.toml`, `clock.csv` or the file of a source; addresses that cannot be listened on.
    pub fn start(folder: &Path, speed: f64) -> Result<Self> {
        let mut field = Field::read(&folder.join("field.toml"))?;
        let recorded = RecordingClock::read(&folder.join("clock.csv"))?;
        let lead_s = LEAD_S * speed;
        let clock = Clock::played(recorded.begin_s - lead_s, speed);
        let begun = Instant::now();
        let stop = Arc::new(AtomicBool::new(false));
        let (mut senders, mut stations) = (Vec::new(), Vec::new());
        let mut span_s: f64 = 0.0;
        for source in &mut field.sources {
            let log = folder.join(source.file());
            let failed = |error| Error::io(&log, error);
            if let Kind::Geocom(_) = source.kind {
                let rows = station_rows(&log)?;
                let rows = rows
                    .iter()
                    .map(|row| (row.time_s - recorded.begin_s + lead_s, row.position_m));
                let measured: Vec<_> = rows.collect();
                span_s = measured.last().map_or(span_s, |last| span_s.max(last.0));
                let settings = SimulatedSettings {
                    speed,
                    reply_time: Duration::from_secs_f64(0.005 / speed),
                    ..SimulatedSettings::default()
                };
                let simulated = Simulated::measuring(settings, measured, begun);
                let station = TcpInstrument::listen("127.0.0.1:0", simulated).map_err(failed)?;
                source.place = Place::Tcp(station.address().to_string());
                stations.push(station);
                continue;
            }
            let link = match source.place {
                Place::Udp(_) => {
                    let free = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr());
                    let to = free.map_err(failed)?.to_string();
                    source.place = Place::Udp(to.clone());
                    let socket = UdpSocket::bind("127.0.0.1:0").map_err(failed)?;
                    socket.connect(to).map_err(failed)?;
                    Link::Datagrams(socket)
                }
                _ => {
                    let listener = TcpListener::bind("127.0.0.1:0").map_err(failed)?;
                    listener.set_nonblocking(true).map_err(failed)?;
                    let address = listener.local_addr().map_err(failed)?;
                    source.place = Place::Tcp(address.to_string());
                    Link::Stream(listener, None)
                }
            };
            let pieces = Pieces::open(&log)?;
            span_s = span_s.max(pieces.last_s()? + lead_s);
            let sender = Sender {
                log,
                link,
                // The header of a table is written by who records.
                skips_first: matches!(source.kind, Kind::Lines(_)),
                is_timed_here: source.kind.is_timed_here(),
                lead_s,
                clock: clock.clone(),
                stop: Arc::clone(&stop),
            };
            senders.push(std::thread::spawn(move || sender.send(pieces)));
        }
        Ok(Self {
            field,
            clock,
            stop,
            senders,
            _stations: stations,
            span_s,
        })
    }

    /// The sources as they are to be recorded.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// The time of the recording.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// From the beginning to the last record, seconds of the recording.
    pub fn span_s(&self) -> f64 {
        self.span_s
    }

    /// Stops to play.
    ///
    /// # Errors
    /// The first error of a sender.
    pub fn finish(mut self) -> Result<()> {
        self.stop.store(true, Ordering::Relaxed);
        let mut ended = Ok(());
        for sender in self.senders.drain(..) {
            let one = sender.join().unwrap_or_else(|_| {
                Err(Error::data("the thread of a sender ended", "report this"))
            });
            ended = ended.and(one);
        }
        ended
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// Where a sender sends.
enum Link {
    Stream(TcpListener, Option<TcpStream>),
    Datagrams(UdpSocket),
}

impl Link {
    /// Sends, if anybody listens.
    fn send(&mut self, bytes: &[u8]) {
        match self {
            Self::Datagrams(socket) => {
                for datagram in bytes.chunks(DATAGRAM) {
                    // Nobody may listen yet, or any more.
                    let _ = socket.send(datagram);
                }
            }
            Self::Stream(listener, client) => {
                if let Ok((stream, _)) = listener.accept() {
                    let _ = stream.set_nonblocking(false);
                    let _ = stream.set_nodelay(true);
                    let _ = stream.set_write_timeout(Some(Duration::from_secs(5)));
                    *client = Some(stream);
                }
                if client
                    .as_mut()
                    .is_some_and(|client| client.write_all(bytes).is_err())
                {
                    *client = None;
                }
            }
        }
    }
}

/// The thread that sends what a sensor sent.
struct Sender {
    log: PathBuf,
    link: Link,
    skips_first: bool,
    is_timed_here: bool,
    lead_s: f64,
    clock: Clock,
    stop: Arc<AtomicBool>,
}

impl Sender {
    fn send(mut self, pieces: Pieces) -> Result<()> {
        let failed = |error| Error::io(&self.log, error);
        let mut file = File::open(&self.log).map_err(failed)?;
        let mut bytes = Vec::new();
        for (number, piece) in pieces.enumerate() {
            let (length, arrived_s) = piece?;
            bytes.resize(length, 0);
            match file.read_exact(&mut bytes) {
                Ok(()) => {}
                // Cut off by a crash.
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
                Err(error) => return Err(failed(error)),
            }
            loop {
                let left_s = arrived_s + self.lead_s - self.clock.now().monotonic_s();
                if self.stop.load(Ordering::Relaxed) {
                    return Ok(());
                }
                if left_s <= 0.0 {
                    break;
                }
                let left = Duration::from_secs_f64(left_s / self.clock.speed());
                std::thread::sleep(left.min(PATIENCE));
            }
            if self.is_timed_here {
                bytes = without_times(&bytes);
            }
            if !(self.skips_first && number == 0) {
                self.link.send(&bytes);
            }
        }
        // A link that is closed would be opened again: it ends with the recording.
        while !self.stop.load(Ordering::Relaxed) {
            std::thread::sleep(PATIENCE);
        }
        Ok(())
    }
}

/// Lines without the times that their recording put before them.
fn without_times(lines: &[u8]) -> Vec<u8> {
    let lines = lines.split_inclusive(|byte| *byte == b'\n');
    let sent = lines.map(|line| {
        let comma = line.iter().position(|byte| *byte == b',');
        &line[comma.map_or(0, |comma| comma + 1)..]
    });
    sent.collect::<Vec<_>>().concat()
}
