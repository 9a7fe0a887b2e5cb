//! Plays a recording: servers send the recorded bytes at the times at which they arrived.

use std::fs::File;
use std::io::{Read, Write};
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

/// Real time before the first piece is sent, so that all links are open, seconds.
const LEAD_S: f64 = 1.0;
/// Longest sleep between two checks whether to stop.
const TICK: Duration = Duration::from_millis(20);
/// Largest datagram.
const DATAGRAM: usize = 1400;

/// A recording that is being played over local sockets.
pub struct Player {
    field: Field,
    clock: Clock,
    stop: Arc<AtomicBool>,
    senders: Vec<JoinHandle<Result<()>>>,
    /// Kept alive as long as the recording is played.
    _stations: Vec<TcpInstrument>,
    span_s: f64,
}

impl Player {
    /// Begins to play the recording in a folder, at `speed` times real time.
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
            span_s = span_s.max(pieces.last_s() + lead_s);
            let sender = Sender {
                log,
                link,
                is_table: matches!(source.kind, Kind::Lines(_)),
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

    /// The sources, with the addresses from which they can be recorded.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// The clock of the recording being played.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Time from the beginning to the last record, seconds of the recording.
    pub fn span_s(&self) -> f64 {
        self.span_s
    }

    /// Stops playing.
    ///
    /// # Errors
    /// The first error of a sender.
    pub fn finish(mut self) -> Result<()> {
        self.stop.store(true, Ordering::Relaxed);
        let mut ended = Ok(());
        for sender in self.senders.drain(..) {
            let result = sender
                .join()
                .unwrap_or_else(|_| Err(Error::data("a sending thread panicked", "report this")));
            ended = ended.and(result);
        }
        ended
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// The socket over which a sensor's bytes are sent.
enum Link {
    Stream(TcpListener, Option<TcpStream>),
    Datagrams(UdpSocket),
}

impl Link {
    /// Sends bytes if a client is connected.
    fn send(&mut self, bytes: &[u8]) {
        match self {
            Self::Datagrams(socket) => {
                for datagram in bytes.chunks(DATAGRAM) {
                    // Nobody may be listening yet, or any more.
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

/// The thread that sends the recorded bytes of a sensor.
struct Sender {
    log: PathBuf,
    link: Link,
    is_table: bool,
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
        for (number, (length, arrived_s)) in pieces.enumerate() {
            bytes.clear();
            let mut piece = (&mut file).take(length as u64);
            piece.read_to_end(&mut bytes).map_err(failed)?;
            loop {
                let left_s = arrived_s + self.lead_s - self.clock.now().monotonic_s();
                if self.stop.load(Ordering::Relaxed) {
                    return Ok(());
                }
                if left_s <= 0.0 {
                    break;
                }
                let left = Duration::from_secs_f64(left_s / self.clock.speed());
                std::thread::sleep(left.min(TICK));
            }
            if self.is_timed_here {
                bytes = without_times(&bytes);
            }
            if self.is_table && number == 0 {
                // The recorder writes the header itself. It leaves out what it receives before the first line end, as a
                // link may be opened in the middle of a row.
                bytes = b"\n".to_vec();
            }
            self.link.send(&bytes);
        }
        // The recorder would reopen a closed link, so it stays open until the player stops.
        while !self.stop.load(Ordering::Relaxed) {
            std::thread::sleep(TICK);
        }
        Ok(())
    }
}

/// Lines without the times of arrival that the recorder put before them.
fn without_times(lines: &[u8]) -> Vec<u8> {
    let lines = lines.split_inclusive(|byte| *byte == b'\n');
    let sent = lines.map(|line| {
        let comma = line.iter().position(|byte| *byte == b',');
        &line[comma.map_or(0, |comma| comma + 1)..]
    });
    sent.collect::<Vec<_>>().concat()
}
