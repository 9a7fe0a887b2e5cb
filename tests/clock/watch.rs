//! The page that shows a run while it works, requested by real clients.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::results::{assert_same, results};
use crate::common::{on_project, simulated};
use serde_json::Value;

/// A run that is watched, and its port.
struct Watched {
    child: Child,
    port: u16,
}

impl Watched {
    fn start(drive: &Path, command: &str, out: &Path) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_boresight"))
            .arg(command)
            .arg(drive.join("project.toml"))
            .args(["--watch", "--quiet", "--out"])
            .arg(out)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        stderr.read_line(&mut line).unwrap();
        let address = line
            .trim()
            .strip_prefix("watch: http://127.0.0.1:")
            .unwrap();
        let port = address.trim_end_matches('/').parse().unwrap();
        // Further output must not fill the pipe.
        std::thread::spawn(move || io::copy(&mut stderr, &mut io::sink()));
        Self { child, port }
    }

    fn ask(&self, path: &str) -> TcpStream {
        self.try_ask(path).unwrap()
    }

    fn try_ask(&self, path: &str) -> io::Result<TcpStream> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port))?;
        let port = self.port;
        write!(
            stream,
            "GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n"
        )?;
        Ok(stream)
    }

    fn get(&self, path: &str) -> (String, Vec<u8>) {
        let mut answer = Vec::new();
        self.ask(path).read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
        let body = answer.split_off(end + 4);
        (String::from_utf8(answer).unwrap(), body)
    }
}

#[test]
fn progress_rises_and_the_page_becomes_the_report() {
    let (_temp, drive) = simulated();
    let out = drive.join("watched");
    let mut watched = Watched::start(&drive, "run", &out);
    let (head, page) = watched.get("/");
    assert!(head.starts_with("HTTP/1.1 200 OK"), "{head}");
    assert!(String::from_utf8(page).unwrap().contains("EventSource"));

    let events = BufReader::new(watched.ask("/events?page=one"));
    let mut shares: BTreeMap<String, f64> = BTreeMap::new();
    let (mut last, mut ended, mut log) = (Value::Null, Value::Null, String::new());
    let mut is_end = false;
    for line in events.lines() {
        let line = line.unwrap();
        is_end |= line == "event: end";
        let Some(data) = line.strip_prefix("data: ") else {
            continue;
        };
        let data: Value = serde_json::from_str(data).unwrap();
        if is_end {
            ended = data;
            break;
        }
        log.push_str(data["log"].as_str().unwrap());
        for stage in data["stages"].as_array().unwrap() {
            let Some(share) = stage["share"].as_f64() else {
                continue;
            };
            // Some stages are run again under other conditions.
            let run = format!("{} of {}", stage["name"], stage["began_s"]);
            let before = shares.insert(run, share).unwrap_or_default();
            assert!((before..=1.0).contains(&share), "{stage}");
        }
        last = data;
    }
    assert_eq!(ended["done"], true);
    assert!(!shares.is_empty());
    for stage in ["calibration", "joint adjustment", "georeferencing"] {
        assert!(log.contains(&format!("  {stage}: ")), "{stage}: {log}");
    }

    let moments = last["pictures"].as_array().unwrap();
    let moments: Vec<&str> = moments
        .iter()
        .map(|p| p["moment"].as_str().unwrap())
        .collect();
    assert_eq!(moments[..2], ["start", "voxels of 100 mm"]);
    let pictures = [0, 1].map(|i| watched.get(&format!("/picture/{i}.png")).1);
    assert!(pictures.iter().all(|png| png.starts_with(b"\x89PNG")));
    assert!(pictures[0] != pictures[1], "the clouds have not moved");
    let (missing, _) = watched.get("/picture/99.png");
    assert!(missing.starts_with("HTTP/1.1 404"), "{missing}");

    let (_, report) = watched.get("/?page=one");
    assert!(report == fs::read(out.join("report.html")).unwrap());
    let loaded = Instant::now();
    assert!(watched.child.wait().unwrap().success());
    assert!(
        loaded.elapsed() < Duration::from_secs(3),
        "the run waits although no page is open"
    );

    let run = on_project(&drive, "run", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert_same(&results(&out), &results(&drive.join("out")));
}

#[test]
fn no_client_delays_the_run_or_changes_its_results() {
    let (_temp, drive) = simulated();
    let began = Instant::now();
    let run = on_project(&drive, "run", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let alone = began.elapsed();

    let out = drive.join("watched");
    let began = Instant::now();
    let mut watched = Watched::start(&drive, "run", &out);
    // Some clients never read, some never send a request, and many close the connection at once.
    let silent: Vec<TcpStream> = (0..20)
        .map(|i| watched.ask(&format!("/events?page={i}")))
        .collect();
    let mute = (0..20).map(|_| TcpStream::connect(("127.0.0.1", watched.port)).unwrap());
    let mute: Vec<TcpStream> = mute.collect();
    for i in 0..200 {
        let stream = TcpStream::connect(("127.0.0.1", watched.port)).unwrap();
        if i % 2 == 0 {
            // The server refuses clients beyond its limit.
            drop(watched.try_ask("/events?page=gone"));
        }
        drop(stream);
    }
    assert!(watched.child.wait().unwrap().success());
    // The run waits up to ten seconds for open pages.
    let most = 2 * alone + Duration::from_secs(15);
    assert!(
        began.elapsed() < most,
        "{:?}, alone {alone:?}",
        began.elapsed()
    );
    drop((silent, mute));
    assert_same(&results(&out), &results(&drive.join("out")));
}

#[test]
fn calibrate_can_be_watched_too() {
    let (_temp, drive) = simulated();
    let mut watched = Watched::start(&drive, "calibrate", &drive.join("watched"));
    let mut events = String::new();
    watched
        .ask("/events?page=one")
        .read_to_string(&mut events)
        .unwrap();
    assert!(
        events.contains("event: end\ndata: {\"done\":true}"),
        "{events}"
    );
    let (_, page) = watched.get("/?page=one");
    assert!(page == fs::read(drive.join("watched/calibration.html")).unwrap());
    assert!(watched.child.wait().unwrap().success());
}
