//! Serves a simulated instrument over TCP or any other stream of bytes.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::super::lines::LONGEST_LINE;
use super::{FaultKind, Simulated};

/// Interval at which a waiting server checks whether it must stop.
const TICK: Duration = Duration::from_millis(10);

/// Answers requests until the stream ends, a fault cuts the cable, or `is_stopped` is set. Reads should
/// have a time-out of some milliseconds: the server checks `is_stopped` in between.
///
/// # Errors
/// If the stream fails.
pub fn serve(
    simulated: &Mutex<Simulated>,
    link: &mut (impl Read + Write),
    is_stopped: &AtomicBool,
) -> io::Result<()> {
    let mut requests = Requests::default();
    let mut bytes = [0; 1024];
    while !is_stopped.load(Ordering::Relaxed) {
        if is_cut(simulated) {
            lock(simulated).counts.cuts += 1;
            return Ok(());
        }
        let count = match link.read(&mut bytes) {
            Ok(0) => return Ok(()),
            Ok(count) => count,
            Err(error) => match error.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => continue,
                _ => return Err(error),
            },
        };
        for request in requests.take(bytes.get(..count).unwrap_or_default()) {
            let start = Instant::now();
            let answered = {
                let mut simulated = lock(simulated);
                let time_s = simulated.time_s();
                simulated.answer(&request, time_s)
            };
            while start.elapsed() < answered.after {
                if is_stopped.load(Ordering::Relaxed) || is_cut(simulated) {
                    break;
                }
                std::thread::sleep(TICK.min(answered.after.saturating_sub(start.elapsed())));
            }
            if is_cut(simulated) {
                break;
            }
            if let Some(mut line) = answered.line {
                line.extend_from_slice(b"\r\n");
                link.write_all(&line)?;
                link.flush()?;
            }
        }
    }
    Ok(())
}

fn is_cut(simulated: &Mutex<Simulated>) -> bool {
    let simulated = lock(simulated);
    simulated
        .fault(simulated.time_s(), |kind| kind == FaultKind::CableOut)
        .is_some()
}

fn lock(simulated: &Mutex<Simulated>) -> MutexGuard<'_, Simulated> {
    simulated.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The instrument's receive buffer: CR ends a request, and LF clears the buffer.
#[derive(Default)]
struct Requests {
    line: Vec<u8>,
    last: u8,
}

impl Requests {
    fn take(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut requests = Vec::new();
        for &byte in bytes {
            match byte {
                b'\r' if self.line.is_empty() => {}
                b'\r' => requests.push(std::mem::take(&mut self.line)),
                // The LF of CR LF arrives when the request has already been taken.
                b'\n' if self.last == b'\r' => {}
                b'\n' => {
                    self.line.clear();
                    requests.clear();
                }
                _ if self.line.len() >= LONGEST_LINE => self.line.clear(),
                _ => self.line.push(byte),
            }
            self.last = byte;
        }
        requests
    }
}

/// A simulated instrument that listens on a TCP port, one client at a time, until dropped.
pub struct TcpInstrument {
    address: SocketAddr,
    simulated: Arc<Mutex<Simulated>>,
    is_stopped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl TcpInstrument {
    /// Listens on an address; port 0 selects any free port.
    ///
    /// # Errors
    /// If the address cannot be listened on.
    pub fn listen(address: &str, simulated: Simulated) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let simulated = Arc::new(Mutex::new(simulated));
        let is_stopped = Arc::new(AtomicBool::new(false));
        let shared = (Arc::clone(&simulated), Arc::clone(&is_stopped));
        let thread = std::thread::spawn(move || accept(&listener, &shared.0, &shared.1));
        Ok(Self {
            address,
            simulated,
            is_stopped,
            thread: Some(thread),
        })
    }

    /// The address on which it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The instrument itself.
    pub fn simulated(&self) -> MutexGuard<'_, Simulated> {
        lock(&self.simulated)
    }
}

impl Drop for TcpInstrument {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn accept(listener: &TcpListener, simulated: &Mutex<Simulated>, is_stopped: &AtomicBool) {
    while !is_stopped.load(Ordering::Relaxed) {
        match listener.accept() {
            // A client whose connection fails is dropped; the next client is served.
            Ok((stream, _)) if !is_cut(simulated) => {
                let _ = serve_client(stream, simulated, is_stopped);
            }
            Ok(_) => {}
            Err(_) => std::thread::sleep(TICK),
        }
    }
}

fn serve_client(
    mut stream: TcpStream,
    simulated: &Mutex<Simulated>,
    is_stopped: &AtomicBool,
) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(TICK))?;
    stream.set_write_timeout(Some(Duration::from_secs(1)))?;
    serve(simulated, &mut stream, is_stopped)
}
