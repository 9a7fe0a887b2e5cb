#![no_main]

use boresight_fuzz::{repair, run};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};

fuzz_target!(|bytes: &[u8]| run("text", bytes));

fuzz_mutator!(|data: &mut [u8], size: usize, most: usize, seed: u32| {
    let size = fuzzer_mutate(data, size, most);
    if !repair::is_left(seed) {
        repair::nmea(&mut data[..size]);
        repair::novatel(&mut data[..size]);
    }
    size
});
