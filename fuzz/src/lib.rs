//! Runs one input of a fuzz target and aborts if it uses too much memory; `readers` checks time and results.

mod memory;
pub mod readers;
pub mod repair;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use readers::{Scratch, Target};

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;

/// Allocations of a call must stay below this many times the size of its input plus [`SPARE_BYTES`].
const MOST_TIMES_INPUT: usize = 4;
const SPARE_BYTES: usize = 64 << 20;

/// Passes `bytes` to every reader of the target `name`.
///
/// # Panics
/// On a fault of a reader. This ends the process, and the fuzzer keeps the input.
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

/// Runs `call`; aborts if `call` has more bytes in use at a time than an input of `input` bytes may need.
pub fn limited(input: usize, call: &mut dyn FnMut()) {
    memory::limited(MOST_TIMES_INPUT * input + SPARE_BYTES, call);
}

/// A new folder, in memory if the system has `/dev/shm`. It is not removed, because the fuzzer ends without
/// dropping anything. `TMPDIR` selects another place.
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
