//! Requests, replies and codes compared with lines and tables of geocompy 1.0.0, and random bytes.

use std::io::{self, ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use boresight::record::geocom::simulated::{Noise, Simulated};
use boresight::record::geocom::{
    Event, Instrument, LONGEST_LINE, Lines, Link, Malformed, Procedure, Reply, Request, ReturnCode,
    TrackingSettings, Value, checksum,
};

fn table(text: &str) -> Vec<(u16, &str)> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| line.split_once(',').unwrap())
        .map(|(number, name)| (number.parse().unwrap(), name))
        .collect()
}

#[test]
fn codes_are_those_of_geocompy() {
    let codes = table(include_str!("data/codes.csv"));
    assert!(codes.len() > 490);
    for code in ReturnCode::ALL {
        let name = code.name().unwrap();
        assert!(codes.contains(&(code.0, name)), "{code}");
    }
    assert_eq!(
        ReturnCode(1293).to_string(),
        "1293 TMC_BUSY (measuring is busy)"
    );
    assert_eq!(ReturnCode(60_000).to_string(), "60000 (unknown code)");
}

#[test]
fn procedures_are_those_of_geocompy() {
    let procedures = table(include_str!("data/procedures.csv"));
    for procedure in Procedure::ALL {
        let pair = (procedure.number(), procedure.name());
        assert!(procedures.contains(&pair), "{procedure}");
        assert_eq!(Procedure::from_number(pair.0), Some(*procedure));
    }
}

#[test]
fn requests_of_geocompy_are_read_and_written_the_same() {
    let lines = include_str!("data/requests.txt")
        .lines()
        .filter(|line| !line.starts_with('#'));
    let mut count = 0;
    for line in lines {
        let request = Request::parse(line.as_bytes()).unwrap();
        let fields = &request.fields;
        let values: Vec<Value> = (0..fields.len())
            .map(|i| match fields.raw(i).unwrap() {
                raw if raw.starts_with('"') => Value::Text(fields.text(i).unwrap()),
                raw if raw.starts_with('\'') => Value::Byte(fields.byte(i).unwrap()),
                raw if raw.contains('.') => Value::float(fields.float(i).unwrap()),
                _ => Value::Integer(fields.integer(i).unwrap()),
            })
            .collect();
        let transaction = request.transaction.unwrap();
        let written = Request::line(
            request.procedure,
            transaction,
            &values,
            request.has_checksum,
        );
        // geocompy writes bytes with upper-case digits, the manual with lower-case ones, so that the
        // checksums of that line differ.
        if values.iter().any(|value| matches!(value, Value::Byte(_))) {
            assert_eq!(values[1..], [Value::Byte(0x0b), Value::Byte(0x2f)]);
        } else {
            assert_eq!(written, line);
        }
        if request.has_checksum {
            let wrong = line.replacen(':', "0:", 1);
            assert!(Request::parse(wrong.as_bytes()).is_err());
        }
        count += 1;
    }
    assert_eq!(count, 56);
}

#[test]
fn replies_of_the_manual_are_read() {
    let reply = Reply::parse(b"%R1P,0,0:0,1996,'07','19','10','13','2f'").unwrap();
    assert_eq!(
        (reply.communication, reply.code),
        (ReturnCode::OK, ReturnCode::OK)
    );
    assert_eq!(reply.fields.integer(0), Some(1996));
    assert_eq!(reply.fields.byte(5), Some(0x2f));
    assert_eq!(reply.fields.byte(0), None);
    let reply = Reply::parse(b"%R1P,3081,7:0").unwrap();
    assert_eq!(reply.communication, ReturnCode::COM_PROC_UNAVAIL);
    assert_eq!((reply.transaction, reply.has_checksum), (7, false));
    let text = Reply::parse(br#"%R1P,0,0:0,"a \"quote\", 50 \%\x9A",0x1F"#).unwrap();
    assert_eq!(text.fields.len(), 2);
    assert_eq!(text.fields.text(0).unwrap(), "a \"quote\", 50 %\u{fffd}");
    assert_eq!(text.fields.integer(1), Some(31));
}

#[test]
fn the_checksum_is_crc_16_arc() {
    // The check value of the catalogue of CRCs.
    assert_eq!(checksum(b"123456789"), 0xbb3d);
    let line = Reply::line(
        ReturnCode::OK,
        5,
        ReturnCode::OK,
        &[Value::float(1.5)],
        true,
    );
    assert!(Reply::parse(line.as_bytes()).unwrap().has_checksum);
    let damaged = line.replace("1.5", "1.6");
    assert_eq!(Reply::parse(damaged.as_bytes()), Err(Malformed::Checksum));
}

#[test]
fn malformed_messages_are_refused() {
    for line in [
        &b""[..],
        b"%R1P",
        b"%R1P,",
        b"%R1P,0",
        b"%R1P,0:",
        b"%R1P,0,1:",
        b"%R1P,0,1:x",
        b"%R1P,-1,1:0",
        b"%R1P,+0,1:0",
        b"%R1P,0,1,2,3:0",
        b"%R1P,0,65536:0",
        b"%R1P,,1:0",
        b"%R1P,0,1:0\x00",
        b"%R1P,0,1:\xff",
        b"%R1Q,0,1:0",
        b" %R1P,0,1:0",
        b"%R1P,0, 1:0",
    ] {
        assert_eq!(
            Reply::parse(line),
            Err(Malformed::Syntax),
            "{}",
            line.escape_ascii()
        );
    }
    let reply = Reply::parse(b"%R1P,0,1:0,nan,inf,1e999,\"open,'1','123','zz',,\"\\").unwrap();
    for i in 0..reply.fields.len() + 1 {
        assert_eq!(reply.fields.float(i), None);
        assert_eq!(reply.fields.text(i), None);
        assert_eq!(reply.fields.byte(i), None);
    }
}

#[test]
fn lines_are_bounded() {
    let mut lines = Lines::default();
    let long = vec![b'x'; 5 * LONGEST_LINE];
    assert_eq!(lines.take(&long), (None, long.len()));
    assert_eq!(
        lines.take(b"yz\r\n%R1P,0,1:0\r\n").0,
        Some(b"%R1P,0,1:0".to_vec())
    );
    assert_eq!(
        (lines.skipped_lines, lines.skipped_bytes),
        (1, 5 * LONGEST_LINE as u64 + 2)
    );
}

#[test]
fn random_bytes_do_not_panic() {
    let mut noise = Noise(7);
    let mut simulated = Simulated::new(Default::default(), |_| [1.0, 2.0, 3.0]);
    let alphabet = b"%R1PQ,,,::0123456789.-e\"'\\x%~ \x00\xff";
    for round in 0..20_000 {
        let length = (noise.number() % 60) as usize;
        let mut line: Vec<u8> = (0..length)
            .map(|_| alphabet[noise.number() as usize % alphabet.len()])
            .collect();
        if round % 2 == 0 {
            let procedure = Procedure::ALL[noise.number() as usize % Procedure::ALL.len()];
            line.splice(0..0, format!("%R1Q,{},1:", procedure.number()).into_bytes());
        } else {
            line.splice(0..0, *b"%R1P,0,1:0,");
        }
        let _ = Request::parse(&line);
        if let Ok(reply) = Reply::parse(&line) {
            for i in 0..=reply.fields.len() {
                let _ = (reply.fields.float(i), reply.fields.integer(i));
                let _ = (reply.fields.text(i), reply.fields.byte(i));
            }
        }
        let _ = simulated.answer(&line, 1e-3 * f64::from(round));
    }
}

/// An instrument gone mad: it answers with random or endless bytes, or not at all.
struct Mad {
    noise: Noise,
    kind: u64,
    last: Vec<u8>,
    timeout: Duration,
}

impl Read for Mad {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let bytes = match self.kind {
            0 => self.noise.bytes(to.len().min(300)),
            1 => vec![b'%'; to.len()],
            2 => format!("%R1P,0,{}:0,1\r\n", self.noise.number() % 70_000).into_bytes(),
            // Random values for the requested transaction.
            3 if !self.last.is_empty() => {
                let request = std::mem::take(&mut self.last);
                let text = String::from_utf8_lossy(&request).into_owned();
                let number = text.split([',', ':']).nth(2).unwrap_or("0").to_owned();
                let code = [0, 1283, 1285, 3101, 13, 5][self.noise.number() as usize % 6];
                let values = ["0", "1e308", "-7", "nan", "9.9,1", "\"", "1,2,3,4,5,6,7,8"];
                let value = values[self.noise.number() as usize % values.len()];
                format!("%R1P,0,{number}:{code},{value}\r\n").into_bytes()
            }
            _ => {
                std::thread::sleep(self.timeout.min(Duration::from_millis(20)));
                return Err(ErrorKind::TimedOut.into());
            }
        };
        let count = bytes.len().min(to.len());
        to[..count].copy_from_slice(&bytes[..count]);
        Ok(count)
    }
}

impl Write for Mad {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        self.last = from.to_vec();
        Ok(from.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Link for Mad {
    fn set_timeout(&mut self, timeout: Duration) -> io::Result<()> {
        self.timeout = timeout;
        Ok(())
    }
}

#[test]
fn no_request_hangs_whatever_the_instrument_sends() {
    let timeout = Duration::from_millis(30);
    for kind in 0..5 {
        for seed in 1..4 {
            let settings = TrackingSettings {
                reply_timeout: timeout,
                search_timeout: timeout,
                ..TrackingSettings::default()
            };
            let (noise, last) = (Noise(seed), vec![]);
            let link = Mad {
                noise,
                kind,
                last,
                timeout,
            };
            let begin = Instant::now();
            if let Ok(mut instrument) = Instrument::connect(link, "mad", settings, || ()) {
                let _ = instrument.start();
                for _ in 0..20 {
                    if let Ok(Event::Measured(measurement)) = instrument.next_event() {
                        let distance_m = measurement.distance_m;
                        assert!(distance_m.is_none_or(|distance_m| distance_m > 0.0));
                    }
                }
                let _ = instrument.stop();
            }
            // Each request ends within four time-outs; there are fewer than 60.
            assert!(
                begin.elapsed() < 60 * 4 * timeout,
                "kind {kind}: {:?}",
                begin.elapsed()
            );
        }
    }
}
