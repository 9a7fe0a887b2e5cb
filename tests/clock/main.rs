//! Tests that depend on time or on the machine, and so must not run beside others: rates and delays, kills at chosen
//! moments, peak memory. All others are in `tests/it`.

#![allow(clippy::unwrap_used)] // helpers fail as tests do

#[allow(dead_code)] // `tests/it` uses the rest
#[path = "../common/mod.rs"]
mod common;

mod corpora;
mod kills;
mod live;
mod memory;
mod rate;
mod record;
mod sbgecom;
mod watch;
