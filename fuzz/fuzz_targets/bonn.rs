#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| boresight_fuzz::run("bonn", bytes));
