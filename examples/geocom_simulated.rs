//! A simulated total station on a TCP port (`tcp ADDRESS`, prints the address) or on standard input and
//! output (`stdio`, for example a pseudo-terminal). It follows a prism on a straight line.

use std::io::{self, Read, Write};
use std::sync::{Mutex, atomic::AtomicBool};

use boresight::record::geocom::simulated::{Simulated, SimulatedSettings, TcpInstrument, serve};

struct Stdio(io::Stdin, io::Stdout);

impl Read for Stdio {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        self.0.lock().read(to)
    }
}

impl Write for Stdio {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        self.1.write(from)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.1.flush()
    }
}

fn main() -> io::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let target = |time_s: f64| [2.0 + 0.1 * time_s, 20.0, 1.0];
    let simulated = Simulated::new(SimulatedSettings::default(), target);
    match arguments.get(1).map(String::as_str) {
        Some("tcp") => {
            let address = arguments.get(2).map_or("127.0.0.1:0", String::as_str);
            let instrument = TcpInstrument::listen(address, simulated)?;
            println!("{}", instrument.address());
            // Serves until standard input ends.
            io::stdin().read_to_end(&mut Vec::new()).map(drop)
        }
        Some("stdio") => {
            let mut link = Stdio(io::stdin(), io::stdout());
            serve(&Mutex::new(simulated), &mut link, &AtomicBool::new(false))
        }
        _ => Err(io::Error::other(
            "found other arguments, expected: tcp ADDRESS, or stdio",
        )),
    }
}
