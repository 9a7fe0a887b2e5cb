#![no_main]

use boresight_fuzz::{repair, run};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};

fuzz_target!(|bytes: &[u8]| run("e57", bytes));

fuzz_mutator!(|data: &mut [u8], size: usize, most: usize, seed: u32| {
    let size = fuzzer_mutate(data, size, most);
    if !repair::is_left(seed) {
        repair::e57(&mut data[..size]);
    }
    size
});
