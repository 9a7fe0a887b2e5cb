//! An allocator that counts the bytes in use and ends the process when a call uses too many.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Bytes in use in all threads.
static IN_USE: AtomicUsize = AtomicUsize::new(0);
/// Most bytes that may be in use; beyond this limit the process ends.
static LIMIT: AtomicUsize = AtomicUsize::new(usize::MAX);

/// The system's allocator, which also counts bytes.
pub struct Counting;

fn add(size: usize) {
    let in_use = IN_USE.fetch_add(size, Relaxed).wrapping_add(size);
    let limit = LIMIT.load(Relaxed);
    if in_use > limit {
        // Allocations for the message must not trigger the limit again.
        LIMIT.store(usize::MAX, Relaxed);
        let over = in_use - limit;
        eprintln!("an allocation of {size} bytes exceeds the limit of the call by {over} bytes");
        eprintln!("{}", std::backtrace::Backtrace::force_capture());
        std::process::abort();
    }
}

// SAFETY: every call is passed on to the system's allocator with the same arguments.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        IN_USE.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Growth in place or a copy: the old bytes count until the new bytes exist.
        add(size);
        let moved = unsafe { System.realloc(at, layout, size) };
        let gone = if moved.is_null() { size } else { layout.size() };
        IN_USE.fetch_sub(gone, Relaxed);
        moved
    }
}

/// Runs `call`, which may use at most `most` bytes more than are in use now.
pub fn limited(most: usize, call: &mut dyn FnMut()) {
    struct Unlimited;
    impl Drop for Unlimited {
        fn drop(&mut self) {
            LIMIT.store(usize::MAX, Relaxed);
        }
    }
    let _unlimited = Unlimited;
    LIMIT.store(IN_USE.load(Relaxed).saturating_add(most), Relaxed);
    call();
}
