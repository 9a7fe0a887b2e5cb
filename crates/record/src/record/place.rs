//! How a sensor is connected: a serial port, a TCP address, a UDP port to listen on.

use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs, UdpSocket};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serial2::SerialPort;

use super::geocom::Link;
use crate::error::{Error, Result};

/// Time-out of a connection attempt.
const CONNECTING: Duration = Duration::from_secs(3);

/// Port or address of a sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// A serial port and its rate in bits per second.
    Serial(PathBuf, u32),
    /// Host and port of a TCP server.
    Tcp(String),
    /// Address and port at which datagrams arrive.
    Udp(String),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(port, _) => write!(f, "{}", port.display()),
            Self::Tcp(address) => f.write_str(address),
            Self::Udp(address) => write!(f, "udp://{address}"),
        }
    }
}

impl Place {
    /// Opens the link.
    ///
    /// # Errors
    /// A link that cannot be opened, with its port or address.
    pub fn open(&self) -> Result<Wire> {
        let failed = |error| Error::io(Path::new(&self.to_string()), error);
        match self {
            Self::Serial(port, baud) => SerialPort::open(port, *baud).map(Wire::Serial),
            Self::Tcp(address) => connect(address).map(Wire::Tcp),
            Self::Udp(address) => UdpSocket::bind(address).map(Wire::Udp),
        }
        .map_err(failed)
    }
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::from(ErrorKind::AddrNotAvailable);
    for place in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&place, CONNECTING) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// An open link.
#[derive(Debug)]
pub enum Wire {
    /// A serial port.
    Serial(SerialPort),
    /// A TCP connection.
    Tcp(TcpStream),
    /// Datagrams.
    Udp(UdpSocket),
}

impl Read for Wire {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Serial(port) => Read::read(port, to),
            Self::Tcp(stream) => stream.read(to),
            Self::Udp(socket) => socket.recv(to),
        }
    }
}

impl Write for Wire {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        match self {
            Self::Serial(port) => Write::write(port, from),
            Self::Tcp(stream) => stream.write(from),
            // Sensors on UDP only send.
            Self::Udp(_) => Err(ErrorKind::Unsupported.into()),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Serial(port) => Write::flush(port),
            Self::Tcp(stream) => stream.flush(),
            Self::Udp(_) => Ok(()),
        }
    }
}

impl Link for Wire {
    fn set_timeout(&mut self, timeout: Duration) -> io::Result<()> {
        match self {
            Self::Serial(port) => {
                port.set_read_timeout(timeout)?;
                port.set_write_timeout(timeout)
            }
            Self::Tcp(stream) => stream.set_timeout(timeout),
            Self::Udp(socket) => socket.set_read_timeout(Some(timeout)),
        }
    }
}
