//! A recording: one thread per source, and one that watches clock and disk.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::clock::{Clock, ClockState, StepWatch};
use super::disk::{DiskWatch, Room};
use super::field::{Field, Kind};
use super::journal::{Disk, Journal};
use super::live::{self, LiveView};
use super::status::{SourceState, Status};
use super::thread::{Events, SourceThread};
use super::{station, stream};
use crate::error::{Error, Result};

/// Time between two checks of clock and sources.
const CHECK: Duration = Duration::from_secs(1);

/// The state of a recording at one time.
#[derive(Debug, Clone)]
pub struct View {
    /// Seconds since it began.
    pub time_s: f64,
    /// Common time of the recording, seconds.
    pub common_s: f64,
    /// Name and state of each source.
    pub sources: Vec<(String, SourceState)>,
    /// The system clock, if chrony answers.
    pub clock: Option<ClockState>,
    /// By how much the clock was set since the last view, seconds.
    pub set_s: Option<f64>,
    /// Free space on the disk, if the system reports it.
    pub room: Option<Room>,
    /// The platform's pose; `None` without a project that describes the logs.
    pub live: Option<LiveView>,
}

/// Records all sources into a new folder until `goes_on`, which is called once a second with a view of the recording,
/// returns false.
///
/// # Errors
/// The folder exists already, or a file cannot be written: the first of these errors, after all sources were stopped.
pub fn record(
    field: &Field,
    folder: &Path,
    clock: &Clock,
    mut goes_on: impl FnMut(&View) -> bool,
) -> Result<()> {
    begin(field, folder)?;
    let disk = Disk::default();
    let events = Events::create(folder, &disk)?;
    let version = env!("CARGO_PKG_VERSION");
    events.add(clock, "recording", &format!("begins, boresight {version}"))?;
    let mut clock_log = Journal::create(&folder.join("clock.csv"), &disk)?;
    clock_log.append(b"unix_s,monotonic_s,reference,offset_s,rms_s,is_locked,set_s\n")?;
    let stop = AtomicBool::new(false);
    let status: Vec<Status> = field.sources.iter().map(|_| Status::default()).collect();
    let live_view = Mutex::new(LiveView::default());
    std::thread::scope(|scope| {
        let threads = field.sources.iter().zip(&status).map(|(source, status)| {
            let thread = SourceThread {
                source,
                folder,
                clock,
                status,
                events: &events,
                disk: &disk,
                stop: &stop,
            };
            scope.spawn(move || {
                let ended = match &thread.source.kind {
                    Kind::Geocom(settings) => station::record(&thread, settings),
                    _ => stream::record(&thread),
                };
                if ended.is_err() {
                    // A full disk stops all sources: data that are not written must not seem recorded.
                    thread.stop.store(true, Ordering::Relaxed);
                }
                thread.status.done();
                ended
            })
        });
        let threads: Vec<_> = threads.collect();
        scope.spawn(|| disk.sync_until(&stop));
        let has_project = !field.project.is_empty();
        if has_project {
            let (view, stop) = (&live_view, &stop);
            scope.spawn(move || live::follow(field, folder, clock, stop, view));
        }
        let watch = Watch {
            field,
            folder,
            clock,
            events: &events,
            status: &status,
            live: has_project.then_some(&live_view),
            stop: &stop,
        };
        let mut ended = {
            let _ending = Ending(&stop);
            watch.run(&mut clock_log, &mut goes_on)
        };
        for thread in threads {
            let result = thread.join().unwrap_or_else(|_| {
                Err(Error::data(
                    "the thread of a source panicked",
                    "report this",
                ))
            });
            ended = ended.and(result);
        }
        ended = ended.and(clock_log.flush());
        let last = if ended.is_ok() {
            "ends"
        } else {
            "ends with an error"
        };
        ended.and(events.add(clock, "recording", last))
    })
}

/// Stops all threads when the watch ends: also when `goes_on` panics, after which the scope would wait for them for ever.
struct Ending<'a>(&'a AtomicBool);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The watch over a recording.
struct Watch<'a> {
    field: &'a Field,
    /// Folder of the recording.
    folder: &'a Path,
    /// The clocks.
    clock: &'a Clock,
    /// The log of events.
    events: &'a Events<'a>,
    /// The states of the sources.
    status: &'a [Status],
    /// The platform's pose, if it is followed.
    live: Option<&'a Mutex<LiveView>>,
    /// Set when the recording ends.
    stop: &'a AtomicBool,
}

impl Watch<'_> {
    /// Checks clock, disk and sources once a second until `goes_on` returns false.
    fn run(
        &self,
        clock_log: &mut Journal<'_>,
        goes_on: &mut dyn FnMut(&View) -> bool,
    ) -> Result<()> {
        let &Self {
            field,
            folder,
            clock,
            events,
            status,
            live,
            stop,
        } = self;
        let mut steps = StepWatch::default();
        let mut was_silent = vec![false; status.len()];
        let mut has_sent = vec![false; status.len()];
        let (mut was_locked, mut was_short) = (None, false);
        let mut disk = DiskWatch::new(folder);
        while !stop.load(Ordering::Relaxed) {
            let begun = Instant::now();
            let now = clock.now();
            let set_s = steps.check(now);
            let state = clock.state();
            let (time_s, monotonic_s) = (now.unix_s(), now.monotonic_s());
            let clock_cells = state.as_ref().map_or(",,,".to_owned(), |state| {
                let locked = u8::from(state.is_locked);
                let reference = state.reference.replace(',', " ");
                format!(
                    "{reference},{:.9},{:.9},{locked}",
                    state.offset_s, state.rms_s
                )
            });
            let set = set_s.map_or(String::new(), |set_s| format!("{set_s:.6}"));
            clock_log
                .append(format!("{time_s:.6},{monotonic_s:.6},{clock_cells},{set}\n").as_bytes())?;
            if let Some(set_s) = set_s {
                events.add(clock, "clock", &format!("set by {set_s:+.3} s"))?;
            }
            let is_locked = state.as_ref().map(|state| state.is_locked);
            if was_locked == Some(true) && is_locked != Some(true) {
                events.add(clock, "clock", "has lost its reference")?;
            }
            was_locked = is_locked;
            let sources: Vec<(String, SourceState)> = (field.sources.iter().zip(status))
                .map(|(source, status)| (source.name.clone(), status.source_state(now)))
                .collect();
            let states = was_silent.iter_mut().zip(&mut has_sent);
            for ((name, source), (was_silent, has_sent)) in sources.iter().zip(states) {
                if source.is_silent != *was_silent && source.records > 0 {
                    let event = if source.is_silent {
                        "silent"
                    } else if *has_sent {
                        "sends again"
                    } else {
                        "sends"
                    };
                    events.add(clock, name, event)?;
                    *has_sent = true;
                }
                *was_silent = source.is_silent;
            }
            let bytes: u64 = sources.iter().map(|(_, source)| source.bytes).sum();
            let room = disk.room(bytes as f64 / monotonic_s.max(1.0));
            if let Some(room) = room
                && room.is_short() != was_short
            {
                was_short = room.is_short();
                let event = if was_short {
                    "nearly full"
                } else {
                    "has room again"
                };
                let text = format!("{event}: {:.2} GB free", 1e-9 * room.free);
                events.add(clock, "disk", &text)?;
            }
            let view = View {
                time_s: monotonic_s,
                common_s: clock.common_s(&now),
                sources,
                clock: state,
                set_s,
                room,
                live: live.map(|live| live.lock().unwrap_or_else(PoisonError::into_inner).clone()),
            };
            if !goes_on(&view) {
                break;
            }
            while begun.elapsed() < CHECK && !stop.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        Ok(())
    }
}

/// Creates the folder, with a copy of `field.toml` and the project.
fn begin(field: &Field, folder: &Path) -> Result<()> {
    if folder.exists() {
        let found = format!("{}: the folder exists already", folder.display());
        return Err(Error::data(found, "choose another folder"));
    }
    fs::create_dir_all(folder).map_err(|error| Error::io(folder, error))?;
    let copy = folder.join("field.toml");
    fs::copy(&field.path, &copy).map_err(|error| Error::io(&copy, error))?;
    if !field.project.is_empty() {
        let project = folder.join("project.toml");
        let text = field.project_text()?;
        fs::write(&project, text).map_err(|error| Error::io(&project, error))?;
    }
    Ok(())
}

/// A new folder for a recording that begins now, named by date and time.
pub fn folder_for(field: &Field, clock: &Clock) -> PathBuf {
    use crate::format::civil_time;
    let name = civil_time(clock.now().unix_s()).replace([':', ' '], "-");
    field.folder.join(name)
}
