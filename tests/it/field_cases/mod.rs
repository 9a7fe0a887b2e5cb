//! Files as people have them: what a format allows, what other writers do, what users once sent.

mod logs;
mod logs_recordings;
