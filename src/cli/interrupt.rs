//! Ctrl-C: the work stops where it can, and leaves nothing half-written behind.

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

/// As shells give it for SIGINT.
pub(super) const EXIT_CODE: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);

/// Whether somebody has asked to stop.
pub(super) fn is_asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// Listens to Ctrl-C. The first time, the work stops at the next place where it can;
/// the second time, the process ends: what it leaves behind is removed by the next run.
pub(super) fn listen() {
    let asked = || {
        if ASKED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
        // Lost if the terminal is gone.
        let _ = writeln!(
            std::io::stderr(),
            "\nstopping (again to end at once): results that are not complete are removed, recordings are kept"
        );
    };
    // Without it, the process ends as it would by default.
    let _ = ctrlc::set_handler(asked);
}
