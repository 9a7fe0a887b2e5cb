//! Runs one input of a fuzz target and aborts if it costs too much memory; the readers themselves check
//! time and results.

mod memory;
pub mod readers;
pub mod repair;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use readers::{Scratch, Target};

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;

/// Allocations of a call stay below this many times its input and [`SPARE_BYTES`].
const MOST_TIMES_INPUT: usize = 4;
const SPARE_BYTES: usize = 64 << 20;

/// Hands `bytes` to every reader that the target `name` has.
///
/// # Panics
/// A fault of a reader, which ends the process: the fuzzer keeps the input.
pub fn run(name: &str, bytes: &[u8]) {
    static PLACE: OnceLock<(&'static Target, Scratch)> = OnceLock::new();
    let (target, scratch) = PLACE.get_or_init(|| {
        let scratch = Scratch::new(&folder()).expect("a folder for the inputs");
        (readers::target(name).expect("a known target"), scratch)
    });
    readers::read_all(target, scratch, bytes, &mut |call| {
        limited(bytes.len(), call)
    });
}

/// Runs `call`, which aborts if it has more bytes in use at a time than an input of so many bytes may cost.
pub fn limited(input: usize, call: &mut dyn FnMut()) {
    memory::limited(MOST_TIMES_INPUT * input + SPARE_BYTES, call);
}

/// A new folder in memory if the system has such a place; it is left behind, because the fuzzer ends without
/// dropping anything. `TMPDIR` names another place.
pub fn folder() -> PathBuf {
    let memory = Path::new("/dev/shm");
    let place = match std::env::var_os("TMPDIR") {
        None if memory.is_dir() => memory.to_owned(),
        _ => std::env::temp_dir(),
    };
    let folder = tempfile::Builder::new()
        .prefix("boresight-fuzz-")
        .tempdir_in(place);
    folder.expect("a temporary folder").keep()
}
