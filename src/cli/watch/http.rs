//! The part of HTTP that a page on the same machine needs.

use std::io::{Read, Result, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Time after which the connection of a slow client is closed.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest request, bytes.
const MAX_REQUEST: usize = 16_384;

/// The request of a client.
#[derive(Debug, PartialEq)]
pub struct Request {
    /// Path without the query.
    pub path: String,
    /// Value of the `Host` header.
    pub host: String,
    /// The value of `page` in the query.
    pub page: String,
}

/// Limits the time that a connection may take.
pub fn limit(stream: &TcpStream) -> Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))
}

impl Request {
    /// Reads a request; if it is invalid, returns the status to refuse it with.
    pub fn read(mut stream: impl Read) -> Result<std::result::Result<Self, &'static str>> {
        let began = Instant::now();
        let mut bytes = Vec::new();
        let mut piece = [0; 1024];
        while !bytes.windows(4).any(|end| end == b"\r\n\r\n") {
            let count = stream.read(&mut piece)?;
            bytes.extend_from_slice(&piece[..count]);
            if count == 0 || bytes.len() > MAX_REQUEST || began.elapsed() > PATIENCE {
                return Ok(Err("400 Bad Request"));
            }
        }
        Ok(Self::parse(&String::from_utf8_lossy(&bytes)))
    }

    fn parse(text: &str) -> std::result::Result<Self, &'static str> {
        let mut lines = text.split("\r\n");
        let mut words = lines.next().unwrap_or_default().split(' ');
        let (Some(method), Some(target), Some(version)) =
            (words.next(), words.next(), words.next())
        else {
            return Err("400 Bad Request");
        };
        if !version.starts_with("HTTP/1.") {
            return Err("400 Bad Request");
        }
        if method != "GET" {
            return Err("405 Method Not Allowed");
        }
        let hosts = lines.filter_map(|line| {
            let (name, value) = line.split_once(':')?;
            name.eq_ignore_ascii_case("host").then(|| value.trim())
        });
        let hosts: Vec<&str> = hosts.collect();
        let [host] = hosts[..] else {
            return Err("400 Bad Request");
        };
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let page = query.split('&').find_map(|pair| pair.strip_prefix("page="));
        Ok(Self {
            path: path.to_owned(),
            host: host.to_ascii_lowercase(),
            page: page.unwrap_or_default().to_owned(),
        })
    }
}

/// Responds with a body of this media type and this content security policy.
pub fn respond(mut stream: &TcpStream, kind: &str, policy: &str, body: &[u8]) -> Result<()> {
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nCache-Control: no-store\r\n\
         Content-Security-Policy: {policy}\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(body)?;
    stream.flush()
}

/// Responds with a status and no body.
pub fn refuse(mut stream: &TcpStream, status: &str) -> Result<()> {
    let text = format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{status}\n",
        status.len() + 1
    );
    stream.write_all(text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_or_refused() {
        let read = |text: &str| Request::read(text.as_bytes()).unwrap();
        let request = read("GET /events?page=a1 HTTP/1.1\r\nhost: LocalHost:80\r\n\r\n").unwrap();
        let expected = Request {
            path: "/events".into(),
            host: "localhost:80".into(),
            page: "a1".into(),
        };
        assert_eq!(request, expected);
        for (text, status) in [
            (
                "POST / HTTP/1.1\r\nHost: a\r\n\r\n",
                "405 Method Not Allowed",
            ),
            ("GET / HTTP/1.1\r\n\r\n", "400 Bad Request"),
            (
                "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
                "400 Bad Request",
            ),
            ("GET /\r\n\r\n", "400 Bad Request"),
            ("\r\n\r\n", "400 Bad Request"),
            ("GET / HTTP/1.1\r\nHost: a\r\n", "400 Bad Request"),
            ("", "400 Bad Request"),
        ] {
            assert_eq!(read(text), Err(status), "{text:?}");
        }
        assert_eq!(read(&"x".repeat(100_000)), Err("400 Bad Request"));
    }
}
