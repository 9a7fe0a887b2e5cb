//! A page on 127.0.0.1 that shows a run while it works, and then shows its report.
//!
//! Each page holds a stream of events open. If a page is closed or stops reading, only its stream ends: the work never
//! waits for a page. Only at the end, the program waits up to ten seconds until open pages have loaded the report.

mod http;

use std::collections::BTreeSet;
use std::io::Write;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::json;

use super::interrupt;
use super::terminal::{Terminal, View};
use crate::error::{Error, Result};
use crate::pipeline::Outcome;
use http::{Request, refuse, respond};

/// The page that shows the work.
const LIVE_PAGE: &str = include_str!("live.html");
const HTML: &str = "text/html; charset=utf-8";
/// The content that the page may load: only itself and resources of this server; the report is self-contained.
const LIVE_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; \
    img-src 'self'; connect-src 'self'";
const REPORT_POLICY: &str = "default-src 'unsafe-inline' 'unsafe-eval' data: blob:";
/// Interval between progress events.
const EVENT_EVERY: Duration = Duration::from_millis(500);
/// Time that the program waits for open pages to load the report.
const LAST_CALL: Duration = Duration::from_secs(10);
/// Most connections at a time.
const MAX_CONNECTIONS: usize = 64;
/// Longest name of a page.
const MAX_NAME: usize = 64;

/// Whether a page shows the work.
#[derive(Debug, clap::Args)]
pub(super) struct Watch {
    /// Show the work in a browser: a page on 127.0.0.1, whose address is printed (a free port unless PORT is
    /// given); it turns into the report, which open pages have ten seconds to load at the end
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "0")]
    watch: Option<u16>,
}

impl Watch {
    /// Shows the progress of `work`, if the option was given, and then the page that it wrote.
    ///
    /// # Errors
    /// The port is taken; errors of the work.
    pub fn over(
        &self,
        terminal: &Terminal,
        page: &Path,
        work: impl FnOnce() -> Result<Outcome>,
    ) -> Result<Outcome> {
        let Some(port) = self.watch else {
            return work();
        };
        let server = Server::start(port, terminal.watched())?;
        // Printed even with --quiet: without the address, the page cannot be opened.
        let _ = writeln!(std::io::stderr(), "watch: {}", server.address);
        let outcome = work();
        server.end(match &outcome {
            Ok(_) => std::fs::read(page)
                .map(Arc::from)
                .map_err(|error| Error::io(page, error).to_string()),
            Err(error) => Err(error.to_string()),
        });
        outcome
    }
}

/// A running server.
struct Server {
    address: String,
    shared: Arc<Shared>,
}

/// State that all connections share.
struct Shared {
    view: View,
    /// Host names by which a browser may address this machine.
    hosts: [String; 2],
    connections: AtomicUsize,
    now: Mutex<Now>,
    /// Notified at the end, and whenever a page has been served.
    changed: Condvar,
}

#[derive(Default)]
struct Now {
    /// The report, or the reason why there is none, once the work has ended.
    end: Option<std::result::Result<Arc<[u8]>, String>>,
    /// Pages that are open and have not loaded the report.
    pages: BTreeSet<String>,
}

impl Server {
    fn start(port: u16, view: View) -> Result<Self> {
        let taken = |error: std::io::Error| {
            Error::data(
                format!("--watch: port {port} of 127.0.0.1 cannot be used: {error}"),
                "give another port, or none to use a free one",
            )
        };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(taken)?;
        let port = listener.local_addr().map_err(taken)?.port();
        let shared = Arc::new(Shared {
            view,
            hosts: [format!("127.0.0.1:{port}"), format!("localhost:{port}")],
            connections: AtomicUsize::new(0),
            now: Mutex::default(),
            changed: Condvar::new(),
        });
        let accepting = shared.clone();
        std::thread::Builder::new()
            .name("watch".into())
            .spawn(move || accept(&listener, &accepting))
            .map_err(taken)?;
        Ok(Self {
            address: format!("http://127.0.0.1:{port}/"),
            shared,
        })
    }

    /// Tells the pages that the work has ended, and waits until open pages have loaded the report.
    fn end(&self, end: std::result::Result<Arc<[u8]>, String>) {
        let until = Instant::now() + LAST_CALL;
        let mut now = self.shared.now();
        now.end = Some(end);
        self.shared.changed.notify_all();
        while !now.pages.is_empty() && Instant::now() < until && !interrupt::is_asked() {
            let waited = self.shared.changed.wait_timeout(now, EVENT_EVERY);
            now = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Shared {
    /// A poisoned state is still valid.
    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn forget(&self, page: &str) {
        self.now().pages.remove(page);
        self.changed.notify_all();
    }
}

/// Takes connections for as long as the program runs.
fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    for stream in listener.incoming().flatten() {
        if shared.connections.fetch_add(1, Ordering::Relaxed) >= MAX_CONNECTIONS {
            shared.connections.fetch_sub(1, Ordering::Relaxed);
            continue;
        }
        let shared_in_thread = shared.clone();
        let spawned = std::thread::Builder::new().spawn(move || {
            // Errors are ignored: the client has gone away.
            let _ = serve(&stream, &shared_in_thread);
            shared_in_thread.connections.fetch_sub(1, Ordering::Relaxed);
        });
        if spawned.is_err() {
            shared.connections.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

fn serve(stream: &TcpStream, shared: &Shared) -> std::io::Result<()> {
    http::limit(stream)?;
    let request = match Request::read(stream)? {
        Ok(request) => request,
        Err(status) => return refuse(stream, status),
    };
    // Requests for other host names that resolve to this machine are refused.
    if !shared.hosts.contains(&request.host) {
        return refuse(stream, "403 Forbidden");
    }
    let page = request.page.chars().take(MAX_NAME).collect::<String>();
    let picture = request.path.strip_prefix("/picture/");
    match (request.path.as_str(), picture) {
        ("/", _) => {
            let report = match &shared.now().end {
                Some(Ok(report)) => Some(report.clone()),
                _ => None,
            };
            let Some(report) = report else {
                return respond(stream, HTML, LIVE_POLICY, LIVE_PAGE.as_bytes());
            };
            respond(stream, HTML, REPORT_POLICY, &report)?;
            shared.forget(&page);
            Ok(())
        }
        ("/events", _) => {
            shared.now().pages.insert(page.clone());
            let sent = send_events(stream, shared);
            let is_loading = matches!((&sent, &shared.now().end), (Ok(()), Some(Ok(_))));
            if !is_loading {
                shared.forget(&page);
            }
            sent
        }
        (_, Some(number)) => {
            let number = number.strip_suffix(".png").and_then(|n| n.parse().ok());
            match number.and_then(|number: usize| shared.view.picture(number)) {
                Some(png) => respond(stream, "image/png", LIVE_POLICY, &png),
                None => refuse(stream, "404 Not Found"),
            }
        }
        _ => refuse(stream, "404 Not Found"),
    }
}

/// Sends progress events to a page until the work has ended.
fn send_events(mut stream: &TcpStream, shared: &Shared) -> std::io::Result<()> {
    stream.write_all(
        b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n\
          Connection: close\r\n\r\n",
    )?;
    let mut log_from = 0;
    loop {
        let (event, log_to) = shared.view.event(log_from);
        stream.write_all(format!("data: {event}\n\n").as_bytes())?;
        log_from = log_to;
        let now = shared.now();
        let is_over = |now: &mut Now| now.end.is_none();
        let waited = shared.changed.wait_timeout_while(now, EVENT_EVERY, is_over);
        let now = waited.unwrap_or_else(PoisonError::into_inner).0;
        let end = match &now.end {
            None => continue,
            Some(Ok(_)) => json!({ "done": true }),
            Some(Err(why)) => json!({ "failed": why }),
        };
        drop(now);
        let (event, _) = shared.view.event(log_from);
        let text = format!("data: {event}\n\nevent: end\ndata: {end}\n\n");
        return stream.write_all(text.as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;
    use crate::progress::Progress;

    fn server() -> (Terminal, Server, u16) {
        let terminal = Terminal::new(true, false);
        let server = Server::start(0, terminal.watched()).unwrap();
        let port = server.address.trim_end_matches('/').rsplit(':').next();
        let port = port.unwrap().parse().unwrap();
        (terminal, server, port)
    }

    fn ask(port: u16, path: &str, host: &str) -> TcpStream {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
        stream
    }

    fn answer(mut stream: TcpStream) -> String {
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn requests_for_other_host_names_are_refused() {
        let (_terminal, _server, port) = server();
        for host in ["boresight.example", "127.0.0.1", "127.0.0.1.example:80", ""] {
            for path in ["/", "/events", "/picture/0.png"] {
                let text = answer(ask(port, path, host));
                assert!(text.starts_with("HTTP/1.1 403"), "{host}{path}: {text}");
            }
        }
        for host in [format!("127.0.0.1:{port}"), format!("LOCALHOST:{port}")] {
            let text = answer(ask(port, "/", &host));
            assert!(text.starts_with("HTTP/1.1 200"), "{host}: {text}");
        }
    }

    #[test]
    fn a_failure_is_sent_to_pages_and_not_waited_for() {
        let (terminal, server, port) = server();
        terminal.begin("calibration", 10);
        terminal.advance(4);
        let page = ask(port, "/events?page=a", &format!("127.0.0.1:{port}"));
        let events = std::thread::spawn(move || answer(page));
        while server.shared.now().pages.is_empty() {
            std::thread::sleep(Duration::from_millis(5));
        }
        let began = Instant::now();
        server.end(Err("no points".into()));
        assert!(began.elapsed() < LAST_CALL / 2, "{:?}", began.elapsed());
        let events = events.join().unwrap();
        assert!(events.contains("\"share\":0.4"), "{events}");
        assert!(
            events.ends_with("event: end\ndata: {\"failed\":\"no points\"}\n\n"),
            "{events}"
        );
    }

    #[test]
    fn the_program_waits_until_an_open_page_has_loaded_the_report() {
        let (_terminal, server, port) = server();
        let host = format!("127.0.0.1:{port}");
        let mut page = ask(port, "/events?page=a", &host);
        let mut byte = [0];
        page.read_exact(&mut byte).unwrap();
        let loads = std::thread::spawn(move || {
            let events = answer(page);
            assert!(
                events.ends_with("event: end\ndata: {\"done\":true}\n\n"),
                "{events}"
            );
            // A browser also takes some time.
            std::thread::sleep(Duration::from_secs(1));
            answer(ask(port, "/?page=a", &host))
        });
        let began = Instant::now();
        server.end(Ok(Arc::from(&b"the report"[..])));
        let waited = began.elapsed();
        assert!(
            (Duration::from_secs(1)..LAST_CALL).contains(&waited),
            "{waited:?}"
        );
        assert!(loads.join().unwrap().ends_with("the report"));
    }

    #[test]
    fn a_port_that_is_taken_is_an_error() {
        let (_terminal, _server, port) = server();
        let other = Terminal::new(true, false);
        let error = Server::start(port, other.watched()).err().unwrap();
        assert!(
            error.to_string().contains(&format!("port {port}")),
            "{error}"
        );
    }
}
