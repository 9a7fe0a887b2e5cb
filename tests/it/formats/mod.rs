//! Files that others wrote, round trips of all that is written here, and damaged files.

mod damage;
mod foreign;
mod positions;
mod round_trips;
