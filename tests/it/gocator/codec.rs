//! Messages and profiles are read back as they were written.

use super::common::{frame, read, settings, stream};
use boresight::format::gocator_stream::data_set;
use boresight::format::gocator_stream::{
    Attributes, Encoder, Kind, Message, NULL_RANGE, ProfileReader, Stamp,
};

fn stamp(frame: u64) -> Stamp {
    Stamp {
        frame,
        time_ticks: 10_240 * frame + 7,
        encoder: -5_000_000_000,
        encoder_at_z: i64::MIN,
        status: 0x311,
        serial_number: 3_000_000_001,
        ptp_time_us: None,
    }
}

fn attributes(width: u32) -> Attributes {
    Attributes {
        count: 2,
        width,
        x_scale_nm: 12_345,
        z_scale_nm: 678,
        x_offset_um: -54_321,
        z_offset_um: 98_765,
        source: 1,
        exposure_ns: 0x0102_0304,
        camera: 1,
        stream_step: None,
        arrayed: None,
    }
}

type Pair = Option<(i32, i32)>;

/// The optional attributes, of which firmware versions send different numbers, and unknown bytes after them.
fn lengths() -> [(Pair, Pair, Vec<u8>); 4] {
    [
        (None, None, vec![]),
        (Some((2, 0)), None, vec![]),
        (Some((8, -1)), Some((4, 3)), vec![]),
        (Some((8, 70_000)), Some((4, 3)), vec![0xab; 5]),
    ]
}

#[test]
fn messages_have_the_bytes_of_the_manual() {
    let mut encoder = Encoder::default();
    encoder.stamps(0, &[stamp(1)], false);
    let bytes = encoder.take();
    assert_eq!(bytes.len(), 14 + 56);
    assert_eq!(bytes[..14], [70, 0, 0, 0, 1, 0, 1, 0, 0, 0, 56, 0, 0, 0]);
    assert_eq!(bytes[14..22], 1u64.to_le_bytes(), "frame");
    assert_eq!(bytes[22..30], 10_247u64.to_le_bytes(), "time");
    assert_eq!(
        bytes[54..58],
        3_000_000_001u32.to_le_bytes(),
        "serial number"
    );

    encoder.point_cloud(&attributes(1), &[[1, 2], [-2, NULL_RANGE]], true);
    let bytes = encoder.take();
    let head = [48, 0, 0, 0, 5, 0x80, 32, 0, 2, 0, 0, 0, 1, 0, 0, 0];
    assert_eq!(bytes[..16], head);
    assert_eq!(
        bytes[32..40],
        [1, 4, 3, 2, 1, 1, 0, 0],
        "source, exposure, camera"
    );
    assert_eq!(bytes[40..], [1, 0, 2, 0, 0xfe, 0xff, 0, 0x80], "points");

    encoder.uniform_profile(&attributes(2), &[5, 6, 7, 8], false);
    assert_eq!(encoder.take()[..8], [48, 0, 0, 0, 6, 0, 32, 0]);

    encoder.intensity(&attributes(2), &[9, 10, 11, 12], true);
    let bytes = encoder.take();
    assert_eq!(bytes[..8], [36, 0, 0, 0, 7, 0x80, 24, 0]);
    assert_eq!(bytes[20..24], (-54_321i32).to_le_bytes(), "x offset");
    assert_eq!(bytes[24], 1, "source");
    assert_eq!(bytes[32..], [9, 10, 11, 12]);
}

#[test]
fn stamps_are_read_back() {
    for ptp_time_us in [None, Some(1_700_000_000_000_000)] {
        for unknown in [vec![], vec![1, 2, 3]] {
            let stamps = [1, 2, 3].map(|frame| Stamp {
                ptp_time_us,
                ..stamp(frame)
            });
            // Without a PTP time, unknown bytes would stand in its place.
            if ptp_time_us.is_none() && !unknown.is_empty() {
                continue;
            }
            let mut encoder = Encoder::with_unknown(unknown);
            encoder.stamps(1, &stamps, true);
            let bytes = encoder.take();
            let Some((Message::Stamps(read), true)) = Message::parse(&bytes) else {
                panic!("no stamps");
            };
            assert_eq!(read.source, 1);
            assert_eq!(read.iter().collect::<Vec<_>>(), stamps);
        }
    }
}

#[test]
fn samples_are_read_back() {
    for (stream_step, arrayed, unknown) in lengths() {
        let attributes = Attributes {
            stream_step,
            arrayed,
            ..attributes(3)
        };
        let mut encoder = Encoder::with_unknown(unknown);
        let raw = [0, -1, i16::MAX, NULL_RANGE, i16::MIN + 1, 1000];
        let points: Vec<_> = raw.iter().map(|&x| [x, 77]).collect();
        encoder.point_cloud(&attributes, &points, false);
        let bytes = encoder.take();
        let Some((Message::Samples(read), false)) = Message::parse(&bytes) else {
            panic!("no samples");
        };
        assert_eq!((read.kind, read.attributes), (Kind::PointCloud, attributes));
        let x_m = |raw: i16| (f64::from(raw) * 12_345.0 - 54_321_000.0) / 1e9;
        let z_m = (77.0 * 678.0 + 98_765_000.0) / 1e9;
        let second: Vec<_> = read.points_m(1).collect();
        let expected = [None, Some([x_m(-32_767), z_m]), Some([x_m(1000), z_m])];
        assert_eq!(second, expected);
        assert_eq!(read.points_m(2).count(), 0, "there are only two");

        encoder.uniform_profile(&attributes, &raw, true);
        let bytes = encoder.take();
        let Some((Message::Samples(read), true)) = Message::parse(&bytes) else {
            panic!("no samples");
        };
        assert_eq!(
            (read.kind, read.attributes),
            (Kind::UniformProfile, attributes)
        );
        let z_m = |raw: i16| (f64::from(raw) * 678.0 + 98_765_000.0) / 1e9;
        let second: Vec<_> = read.points_m(1).collect();
        let expected = [
            None,
            Some([x_m(1), z_m(-32_767)]),
            Some([x_m(2), z_m(1000)]),
        ];
        assert_eq!(second, expected);

        encoder.intensity(&attributes, &[1, 2, 3, 4, 5, 255], true);
        let bytes = encoder.take();
        let Some((Message::Samples(read), true)) = Message::parse(&bytes) else {
            panic!("no samples");
        };
        let without_z = Attributes {
            z_scale_nm: 0,
            z_offset_um: 0,
            ..attributes
        };
        assert_eq!((read.kind, read.attributes), (Kind::Intensity, without_z));
        assert_eq!(read.intensity(1), [4, 5, 255]);
    }
}

#[test]
fn profiles_are_read_back() {
    for is_uniform in [false, true] {
        for has_intensity in [false, true] {
            let settings = settings(100, is_uniform);
            let (bytes, ends) = stream(5, &settings, has_intensity);
            let (profiles, counts) = read(&bytes, bytes.len());
            assert_eq!(profiles.len(), 5);
            assert_eq!((counts.gaps, counts.sets, counts.profiles), (0, 5, 5));
            for (index, profile) in profiles.iter().enumerate() {
                let sent = frame(index as u64, 100, has_intensity);
                assert_eq!(profile.frame, index as u64);
                assert!((profile.time_us - sent.time_us).abs() < 0.5);
                assert_eq!(profile.bytes.end, ends[index] as u64);
                assert_eq!(profile.stamp.serial_number, settings.serial_number);
                let valid: Vec<usize> = (0..100)
                    .filter(|&it| !sent.points_m[it][0].is_nan())
                    .collect();
                assert_eq!(profile.x_m.len(), valid.len());
                for (nth, &point) in valid.iter().enumerate() {
                    let [x_m, z_m] = sent.points_m[point];
                    assert!((profile.x_m[nth] - x_m).abs() < 13e-6);
                    assert!((profile.z_m[nth] - z_m).abs() < 4e-6);
                }
                let intensity = has_intensity.then(|| valid.iter().map(|&it| it as u8).collect());
                assert_eq!(profile.intensity, intensity);
            }
        }
    }
}

#[test]
fn one_message_can_hold_several_frames() {
    let settings = settings(20, false);
    let frames = [0, 1, 2].map(|index| frame(index, 20, true));
    let mut encoder = Encoder::default();
    data_set(&mut encoder, &settings, 40, &frames);
    let bytes = encoder.take();
    let (profiles, counts) = read(&bytes, bytes.len());
    assert_eq!(counts.sets, 1);
    let (single, _) = stream(3, &settings, true);
    let (single, _) = read(&single, 1000);
    for (index, (profile, single)) in profiles.iter().zip(&single).enumerate() {
        assert_eq!(profile.frame, 40 + index as u64);
        assert_eq!(profile.x_m, single.x_m);
        assert_eq!(profile.z_m, single.z_m);
        assert_eq!(profile.intensity, single.intensity);
    }
    assert_eq!(profiles.len(), 3);
}

#[test]
fn messages_can_come_in_any_order_and_with_other_types_between() {
    let attributes = Attributes {
        count: 1,
        ..attributes(2)
    };
    let mut encoder = Encoder::default();
    for frame in 0..3 {
        encoder.intensity(&attributes, &[7, 8], false);
        encoder.other(10, &[0; 30], false);
        encoder.point_cloud(&attributes, &[[1, 2], [3, 4]], false);
        encoder.stamps(1, &[stamp(99)], false);
        encoder.stamps(0, &[stamp(frame)], false);
        encoder.other(36, &[], true);
    }
    let (profiles, counts) = read(&encoder.take(), 5);
    assert_eq!(
        profiles.iter().map(|it| it.frame).collect::<Vec<_>>(),
        [0, 1, 2]
    );
    assert!(profiles.iter().all(|it| it.intensity == Some(vec![7, 8])));
    assert_eq!(
        (counts.messages, counts.other_messages, counts.gaps),
        (18, 6, 0)
    );
}

#[test]
fn a_profile_does_not_get_the_intensity_of_another() {
    let top = Attributes {
        count: 1,
        source: 0,
        ..attributes(2)
    };
    let bottom = Attributes { source: 1, ..top };
    let mut encoder = Encoder::default();
    encoder.stamps(0, &[stamp(0)], false);
    encoder.point_cloud(&top, &[[1, 2], [3, 4]], false);
    encoder.point_cloud(&bottom, &[[1, 2], [3, 4]], false);
    encoder.intensity(&bottom, &[7, 8], true);
    let (profiles, _) = read(&encoder.take(), 1000);
    assert_eq!(profiles[0].intensity, None);
    assert_eq!(profiles[1].intensity, Some(vec![7, 8]));
}

#[test]
fn a_profile_is_complete_when_the_next_message_begins() {
    let (bytes, ends) = stream(2, &settings(10, false), false);
    let mut reader = ProfileReader::new();
    let mut count = 0;
    reader.read(&bytes[..ends[0]], |_| count += 1);
    assert_eq!(count, 0);
    reader.read(&bytes[ends[0]..ends[0] + 16], |_| count += 1);
    assert_eq!(count, 1);
    reader.read(&bytes[ends[0] + 16..], |_| count += 1);
    reader.finish(|_| count += 1);
    assert_eq!(count, 2);
}

#[test]
fn time_is_counted_in_ticks() {
    // At 100 Hz, frames are 10240 ticks apart (LMI's knowledge base).
    assert_eq!(Stamp::ticks(10_000.0), 10_240);
    let stamp = Stamp {
        time_ticks: 10_240,
        ..Stamp::default()
    };
    assert!((stamp.time_us() - 10_000.0).abs() < 1e-9);
}
