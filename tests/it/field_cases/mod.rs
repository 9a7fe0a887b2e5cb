//! Files as people have them: what a format allows, what other writers do, what users once sent. One test for each folder
//! of `tests/data/field_cases`.

mod clouds;
mod logs;
mod logs_recordings;
mod navigation;
mod relatives;
