use super::*;
use crate::geometry::Vec3;
use crate::preflight::Log;

fn vertical_axis(cosine: f64) -> Contradiction {
    Contradiction::Axes(VerticalAxis {
        given: BodyAxes::Frd,
        axis: 1,
        cosine,
    })
}

#[test]
fn what_spoils_the_poses_is_a_fault_and_the_rest_needs_care() {
    let held = Contradiction::Held(HeldAxis {
        file: "imu.csv".into(),
        sensor: ImuSensor::Gyro,
        axis: 0,
        value: 0.0,
        held: 4000,
        samples: 5500,
        noisy_axis: 2,
        noise: 2.5e-4,
    });
    let rounded = Contradiction::Rounded(RoundedPositions {
        file: "prism.csv".into(),
        position: "prism".into(),
        axis: 1,
        step_m: 0.5,
        sigma_m: 0.005,
        single_from_m: Some(4_194_304.0),
    });
    let late = Contradiction::Late(LateLog {
        log: Log::Position(0),
        name: "prism".into(),
        late_s: 18.05,
        scales: Some(TimeScales::GpsUtc),
    });
    let noise = Contradiction::Noise(PositionNoise {
        position: "prism".into(),
        factors: Vec3::new(6.2, 1.0, 2.0),
        sigma_m: Vec3::new(0.031, 0.005, 0.01),
    });
    let (fault, care) = (Severity::Fault, Severity::Care);
    let position = || "prism".to_owned();
    let expected = [
        (
            held,
            fault,
            "imu.held",
            "imu.csv: gyro_x stays at 0 rad/s for 4000 of the 5500 samples during motion, while gyro_z scatters by \
             2.5e-4 rad/s: it was not measured. Record all three axes.",
        ),
        (
            rounded,
            fault,
            "prism.rounded",
            "prism.csv: north of `prism` is written in steps of 0.5000 m, as in single precision (32 bits) from 4194304 m \
             on, but the stated standard deviation is 0.0050 m: what lies between the steps is lost. Write the log anew \
             with all digits.",
        ),
        (
            late,
            care,
            "prism.time_offset",
            "Judging by its turns, `prism` is 18.1 s later than the other logs (GPS and UTC differ by 18 s): a run \
             corrects it. Add -18.1 to [prism] time_offset_s.",
        ),
        (
            vertical_axis(-0.9),
            care,
            "frame.body",
            "According to gravity, the z axis of the IMU points up, but frame.body is \"FRD\": write body = \"FLU\".",
        ),
        (
            vertical_axis(0.1),
            fault,
            "frame.body",
            "According to gravity, the y axis of the IMU is vertical, but with frame.body = \"FRD\" it is z: are the \
             columns of the IMU exchanged, or is it mounted on its side? Rotate its log into body axes.",
        ),
        (
            Contradiction::OppositeHeadings {
                are_from_east: true,
            },
            care,
            "heading.sign",
            "The headings turn to the left where the gyro turns to the right: they count counter-clockwise from east: \
             write 90 − heading. A run leaves them out.",
        ),
        (
            Contradiction::LeftHanded {
                position: position(),
            },
            fault,
            "prism.axes",
            "The course of `prism` turns to the left where the gyro turns to the right: its coordinates are \
             left-handed. Are east and north exchanged, or one of them negated?",
        ),
        (
            Contradiction::DrivenDirection {
                position: position(),
                off_rad: -std::f64::consts::FRAC_PI_2,
            },
            care,
            "heading.direction",
            "According to its headings, the body drives −90° off the direction in which it points (course of `prism`): \
             are the antennas exchanged or across, or does it drive backwards?",
        ),
        (
            noise,
            care,
            "prism.noise",
            "Neighbouring fixes of `prism` scatter up to 6 times as much as its standard deviations say: a run raises \
             them. Write sigma_m = [0.0310, 0.0050, 0.0100].",
        ),
    ];
    for (found, severity, code, text) in expected {
        let verdict = contradiction(&found);
        assert_eq!((verdict.severity, verdict.code.as_str()), (severity, code));
        assert_eq!(verdict.text, text);
    }
}

#[test]
fn only_logs_without_contradictions_are_called_consistent() {
    let codes = |contradictions: Vec<Contradiction>| {
        let findings = LogFindings {
            contradictions,
            ..LogFindings::default()
        };
        let verdicts = raw(&findings).into_iter();
        verdicts.map(|verdict| verdict.code).collect::<Vec<_>>()
    };
    assert_eq!(codes(Vec::new()), ["logs.consistent"]);
    assert_eq!(codes(vec![vertical_axis(0.1)]), ["frame.body"]);
}
