//! Ctrl-C: the work stops at the next possible place, and leaves no incomplete files.

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code that shells use for SIGINT.
pub(super) const EXIT_CODE: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);

/// Whether the user has asked to stop.
pub(super) fn is_asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// Handles Ctrl-C. The first time, the work stops at the next possible place; the second time, the process ends, and
/// the next run removes its temporary files.
pub(super) fn listen() {
    let on_interrupt = || {
        if ASKED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
        // The message is lost if the terminal is gone.
        let _ = writeln!(
            std::io::stderr(),
            "\nstopping (press again to end at once): incomplete results are removed, recordings are kept"
        );
    };
    // Without the handler, Ctrl-C ends the process as by default.
    let _ = ctrlc::set_handler(on_interrupt);
}
