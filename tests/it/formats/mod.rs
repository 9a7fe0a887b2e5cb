//! Files of other programs, round trips of all formats that are written, and damaged files.

mod damage;
mod foreign;
mod positions;
mod round_trips;
