//! Tracks with the instrument at a TCP address for some seconds and prints its events:
//! `ADDRESS SECONDS [checksum]`.

use std::error::Error;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use boresight::record::geocom::{Event, Instrument, TrackingSettings};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, address, seconds, ..] = &arguments[..] else {
        return Err("expected: ADDRESS SECONDS [checksum]".into());
    };
    let settings = TrackingSettings {
        prism_type: Some(7),
        checksum: arguments.iter().any(|argument| argument == "checksum"),
        ..TrackingSettings::default()
    };
    let link = TcpStream::connect(address)?;
    link.set_nodelay(true)?;
    let start = Instant::now();
    let mut instrument = Instrument::connect(link, address, settings, move || start.elapsed())?;
    println!("{:?}", instrument.identity());
    instrument.start()?;
    let end = Instant::now() + Duration::from_secs_f64(seconds.parse()?);
    while Instant::now() < end {
        match instrument.next_event()? {
            Event::Measured(found) => println!(
                "{:.6} {:.6} {:?} {:?} {:?} {:?}",
                found.arrived.as_secs_f64(),
                found.round_trip.as_secs_f64(),
                found.class,
                found.angles.map(|angles| [angles.hz_rad, angles.v_rad]),
                found.distance_m,
                found.instrument_time_s
            ),
            other => println!("{other:?}"),
        }
    }
    instrument.stop()?;
    println!("{:?}", instrument.counters());
    Ok(())
}
