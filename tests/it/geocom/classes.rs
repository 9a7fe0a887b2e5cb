//! The class of a measurement for each return code, with scripted replies.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::time::Duration;

use boresight::record::geocom::{
    Class, Event, Instrument, Link, Measurement, Procedure, Request, TrackingSettings,
};

/// Answers each measurement with the next of some replies, and accepts all other requests.
struct Scripted {
    replies: VecDeque<&'static str>,
    unread: VecDeque<u8>,
}

impl Read for Scripted {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        if self.unread.is_empty() {
            Err(ErrorKind::TimedOut.into())
        } else {
            self.unread.read(to)
        }
    }
}

impl Write for Scripted {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        let Ok(request) = Request::parse(from.trim_ascii()) else {
            return Err(io::Error::other("not a request"));
        };
        let number = Procedure::GetFullMeas.number();
        let reply = match request.procedure {
            procedure if procedure == number => self.replies.pop_front().unwrap_or("5"),
            _ => "0,1",
        };
        let transaction = request.transaction.unwrap_or(0);
        self.unread
            .extend(format!("%R1P,0,{transaction}:{reply}\r\n").bytes());
        Ok(from.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Link for Scripted {
    fn set_timeout(&mut self, _: Duration) -> io::Result<()> {
        Ok(())
    }
}

fn measure(replies: &[&'static str]) -> Vec<Measurement<()>> {
    let (replies, unread) = (replies.iter().copied().collect(), VecDeque::new());
    let link = Scripted { replies, unread };
    let settings = TrackingSettings {
        reply_timeout: Duration::from_millis(50),
        ..TrackingSettings::default()
    };
    let mut instrument = Instrument::connect(link, "script", settings, || ()).unwrap();
    instrument.start().unwrap();
    let mut measurements = vec![];
    while let Ok(Event::Measured(measurement)) = instrument.next_event() {
        measurements.push(measurement);
    }
    measurements
}

#[test]
fn the_return_code_decides_the_class_of_a_measurement() {
    let with = [
        ("0,1,1.5,0,0,0,0,20,1000", Class::Full, true),
        ("1283,1,1.5,0,0,0,0,20,2000", Class::NoFullCorrection, true),
        (
            "1284,1,1.5,0,0,0,0,2.0E+01,3000.0",
            Class::NoFullCorrection,
            true,
        ),
        ("1285,1,1.5,0,0,0,0,20,4000", Class::AnglesOnly, false),
        ("1288,1,1.5,0,0,0,0,0,0", Class::AnglesOnly, false),
        ("1289,1,1.5,0,0,0,0,0,0", Class::AnglesOnly, false),
        // A distance of zero stands for none.
        ("0,1,1.5,0,0,0,0,0,0", Class::AnglesOnly, false),
    ];
    let without = [
        ("1285", Class::Nothing, false),
        ("1290,0,0,0,0,0,0,0,0", Class::Nothing, false),
        ("1291,0,0,0,0,0,0,0,0", Class::Nothing, false),
        ("1292,1,1.5,0,0,0,0,20,5000", Class::Nothing, false),
        ("16", Class::Nothing, false),
        ("60000", Class::Nothing, false),
    ];
    let all: Vec<_> = with.iter().chain(&without).collect();
    let replies: Vec<_> = all.iter().map(|(reply, ..)| *reply).collect();
    let measurements = measure(&replies);
    assert_eq!(measurements.len(), all.len());
    for (i, (m, (reply, class, has_distance))) in measurements.iter().zip(all).enumerate() {
        assert_eq!(m.class, *class, "{reply}");
        assert_eq!(m.distance_m.is_some(), *has_distance, "{reply}");
        assert_eq!(m.instrument_time_s.is_some(), *has_distance, "{reply}");
        assert_eq!(m.angles.is_some(), i < with.len(), "{reply}");
    }
    assert_eq!(measurements[2].distance_m, Some(20.0));
    assert_eq!(measurements[2].instrument_time_s, Some(3.0));
}

#[test]
fn a_request_is_repeated_if_the_reply_has_unexpected_values() {
    let measurements = measure(&[
        "0,1,1.5",
        "0,7,1.5,0,0,0,0,20,1000",
        "0,nan,1.5,0,0,0,0,20,1000",
        "0,1,1.5,0,0,0,0,20",
        "0",
        "0,1,1.5,0,0,0,0,20,1000",
    ]);
    assert_eq!(measurements.len(), 1);
    assert_eq!(measurements[0].distance_m, Some(20.0));
}
