use super::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

const RATE_HZ: f64 = 100.0;
/// Gyroscope noise of the benchmark's rover, rad/s/√Hz and rad/s/√s.
const WHITE: f64 = 4.4e-5;
const WALK: f64 = 2e-6;
/// An estimate is off by more than this many standard deviations in one of 16,000 cases.
const SIGMAS: f64 = 4.0;

struct Noise(ChaCha8Rng);

impl Noise {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// White noise of the given density, averaged over sampling intervals.
    fn white(&mut self, n: usize, density: f64) -> Vec<f64> {
        (0..n)
            .map(|_| density * RATE_HZ.sqrt() * self.normal())
            .collect()
    }

    /// A first-order Gauss-Markov bias: each sample is `memory` times the last plus noise of sigma `push`.
    fn bias(&mut self, n: usize, memory: f64, push: f64) -> Vec<f64> {
        let mut bias = 0.0;
        (0..n)
            .map(|_| {
                bias = memory * bias + push * self.normal();
                bias
            })
            .collect()
    }

    fn white_and_walk(&mut self, seconds: usize) -> Vec<f64> {
        let n = seconds * RATE_HZ as usize;
        let white = self.white(n, WHITE);
        sum(&white, &self.bias(n, 1.0, WALK / RATE_HZ.sqrt()))
    }
}

fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

fn figures(values: &[f64]) -> AxisNoise {
    axis_noise(allan_curve(values, 1.0 / RATE_HZ))
}

#[track_caller]
fn assert_determined(figure: Figure, truth: f64) {
    let Figure::Determined { value, sigma } = figure else {
        panic!("{figure:?}, not {truth}");
    };
    assert!(
        (value - truth).abs() < SIGMAS * sigma,
        "{value} ± {sigma}, not {truth}"
    );
}

/// The definition: half the mean square difference of neighbouring means, over all start samples.
fn deviation_by_definition(values: &[f64], m: usize) -> f64 {
    let mean = |from: usize| values[from..from + m].iter().sum::<f64>() / m as f64;
    let squares: Vec<f64> = (0..=values.len() - 2 * m)
        .map(|k| (mean(k + m) - mean(k)).powi(2))
        .collect();
    (squares.iter().sum::<f64>() / (2.0 * squares.len() as f64)).sqrt()
}

#[test]
fn the_curve_agrees_with_the_definition() {
    let mut noise = Noise::new(1);
    let values: Vec<f64> = noise.white(1000, 1.0).iter().map(|x| x + 9.81).collect();
    let curve = allan_curve(&values, 0.01);
    assert_eq!(curve.len(), 8);
    for (i, point) in curve.iter().enumerate() {
        let m = 1 << i;
        assert!((point.tau_s - 0.01 * f64::from(m)).abs() < 1e-12);
        let expected = deviation_by_definition(&values, m as usize);
        // Sums of a thousand numbers of order 10 round by less than 1e-11.
        assert!((point.deviation - expected).abs() < 1e-11 * expected, "{m}");
    }
}

#[test]
fn series_that_can_be_computed_by_hand_are_right() {
    let ramp: Vec<f64> = (0..64).map(|k| 3.0 * f64::from(k)).collect();
    for (i, point) in allan_curve(&ramp, 1.0).iter().enumerate() {
        // Means over m neighbours differ by 3 m.
        let expected = 3.0 * f64::from(1 << i) / 2f64.sqrt();
        assert!((point.deviation - expected).abs() < 1e-10, "{i}");
    }
    let sign: Vec<f64> = (0..64).map(|k| f64::from(1 - 2 * (k % 2))).collect();
    let curve = allan_curve(&sign, 1.0);
    assert!((curve[0].deviation - 2f64.sqrt()).abs() < 1e-12);
    assert!(curve[1..].iter().all(|p| p.deviation < 1e-12));
    assert!(allan_curve(&[], 1.0).is_empty());
    assert!(allan_curve(&[1.0], 1.0).is_empty());
}

/// 2 mean² / variance of the estimates over many logs must be close to the degrees of freedom: not much
/// less, and not more than twice as much.
#[test]
fn degrees_of_freedom_match_the_scatter_over_many_logs() {
    const LOGS: usize = 600;
    let mut noise = Noise::new(2);
    let curves: Vec<Vec<AllanPoint>> = (0..LOGS)
        .map(|_| allan_curve(&noise.white(512, 1.0), 1.0))
        .collect();
    for i in 0..curves[0].len() {
        let all = || curves.iter().map(|curve| curve[i].variance());
        let mean = all().sum::<f64>() / LOGS as f64;
        let variance = all().map(|x| (x - mean).powi(2)).sum::<f64>() / (LOGS - 1) as f64;
        let (sampled, claimed) = (2.0 * mean * mean / variance, curves[0][i].dof);
        // The variance of a chi-square with f degrees is itself known to √((2 + 12 / f) / 600).
        let chance = SIGMAS * ((2.0 + 12.0 / claimed) / LOGS as f64).sqrt();
        let share = sampled / claimed;
        assert!(
            share > 1.0 - chance && share < 2.0 + chance,
            "{i}: {sampled}, {claimed}"
        );
    }
}

#[test]
fn white_noise_and_random_walk_are_recovered() {
    for seed in 0..6 {
        let figures = figures(&Noise::new(10 + seed).white_and_walk(7200));
        assert_determined(figures.white, WHITE);
        assert_determined(figures.walk, WALK);
        // The minimum of n²/τ + w² τ/3 is 2 n w / √3; half an octave away, the largest distance to a
        // point of the curve, it is (√2 + 1/√2) / 2 = 1.06 times that.
        let floor = (2.0 * WHITE * WALK / 3f64.sqrt()).sqrt() * 1.03f64.sqrt();
        assert_determined(figures.instability, floor / FLICKER_FLOOR);
    }
}

#[test]
fn a_gauss_markov_bias_has_the_minimum_of_the_closed_form() {
    let (time_s, sigma) = (100.0, 6e-5);
    let memory = (-1.0 / (RATE_HZ * time_s)).exp();
    let push = sigma * (1.0f64 - memory * memory).sqrt();
    let closed = |tau: f64| {
        let x = tau / time_s;
        let bias = 2.0 * sigma * sigma / x
            * (1.0 - (3.0 - 4.0 * (-x).exp() + (-2.0 * x).exp()) / (2.0 * x));
        (WHITE * WHITE / tau + bias).sqrt()
    };
    for seed in 0..6 {
        let mut noise = Noise::new(20 + seed);
        let n = 7200 * RATE_HZ as usize;
        let white = noise.white(n, WHITE);
        let values = sum(&white, &noise.bias(n, memory, push));
        let figures = figures(&values);
        for point in &figures.curve {
            let off = (point.deviation / closed(point.tau_s)).ln() / point.relative_sigma();
            assert!(off.abs() < SIGMAS, "{}: {off} sigmas", point.tau_s);
        }
        assert_determined(figures.white, WHITE);
        // The curve has its maximum at 1.89 correlation times and falls beyond it without end.
        let short = figures.curve.iter().filter(|p| p.tau_s < time_s);
        let lowest = short.map(|p| closed(p.tau_s)).fold(f64::INFINITY, f64::min);
        assert_determined(figures.instability, lowest / FLICKER_FLOOR);
    }
}

#[test]
fn a_short_log_leaves_figures_undetermined() {
    let mut determined = 0;
    for seed in 0..20 {
        let mut noise = Noise::new(40 + seed);
        let figures = figures(&noise.white(60_000, WHITE));
        assert_determined(figures.white, WHITE);
        assert_eq!(figures.walk, Figure::Undetermined);
        match figures.instability {
            Figure::AtMost { value } => {
                // The bound is no lower than ten minutes allow: white noise at the longest time with
                // nine degrees of freedom, a tenth of the log.
                assert!(value > 0.5 * WHITE / 60f64.sqrt(), "{value}");
            }
            Figure::Determined { .. } => determined += 1,
            Figure::Undetermined => panic!("no bound"),
        }
    }
    // By chance, the minimum is two sigmas higher in one log of forty.
    assert!(determined <= 2, "{determined} of 20");
    // Over ten minutes, a random walk only begins to rise.
    let rising = figures(&Noise::new(61).white_and_walk(60));
    assert!(
        matches!(rising.instability, Figure::AtMost { .. }),
        "{rising:?}"
    );
    // A log too short for any figure; a sensor with constant output.
    assert_eq!(
        figures(&Noise::new(62).white(40, WHITE)).white,
        Figure::Undetermined
    );
    let silent = figures(&[0.25; 10_000]);
    assert_eq!(
        (silent.white, silent.instability),
        (Figure::Undetermined, Figure::Undetermined)
    );
}

/// Sensors that smooth their output show less noise at short times; the density is taken where the
/// deviation falls like that of white noise.
#[test]
fn smoothing_in_the_sensor_does_not_lower_the_density() {
    let white = Noise::new(70).white(360_000, WHITE);
    let smooth: Vec<f64> = white
        .windows(8)
        .map(|w| w.iter().sum::<f64>() / 8.0)
        .collect();
    let density = figures(&smooth).white.determined().unwrap();
    // The slope may differ by 0.2: the variance of the first point is then too low by a factor of up to
    // 2^0.2 and that of the next by half as much, less than 10 % of the density.
    assert!((density / WHITE - 1.0).abs() < 0.10, "{density}");
}

/// An IMU on a slightly tilted table.
fn resting(seed: u64, seconds: usize) -> Vec<ImuSample> {
    let mut noise = Noise::new(seed);
    let n = seconds * RATE_HZ as usize;
    let gyro: [Vec<f64>; 3] = std::array::from_fn(|_| noise.white(n, WHITE));
    let accel: [Vec<f64>; 3] = std::array::from_fn(|_| noise.white(n, 5.6e-4));
    let vector = |axes: &[Vec<f64>; 3], k: usize| Vec3::new(axes[0][k], axes[1][k], axes[2][k]);
    (0..n)
        .map(|k| ImuSample {
            time_s: 100.0 + k as f64 / RATE_HZ,
            gyro_rad_s: vector(&gyro, k) + Vec3::new(1.5e-3, -1.0e-3, 0.8e-3),
            accel_m_s2: vector(&accel, k) + Vec3::new(0.1, -0.05, 9.84),
        })
        .collect()
}

#[test]
fn a_log_at_rest_gives_figures_of_every_axis() {
    let estimate = allan(&resting(80, 120)).unwrap();
    assert!(estimate.warnings.is_empty(), "{:?}", estimate.warnings);
    assert_eq!(estimate.samples, 12_000);
    assert!((estimate.interval_s - 0.01).abs() < 1e-9);
    for axis in &estimate.gyro {
        assert_determined(axis.white, WHITE);
    }
    for axis in &estimate.accel {
        assert_determined(axis.white, 5.6e-4);
    }
}

#[test]
fn motion_is_refused_and_named() {
    let refused = |change: fn(f64, &mut ImuSample)| {
        let mut log = resting(81, 60);
        for sample in &mut log {
            change(sample.time_s - 100.0, sample);
        }
        allan(&log).unwrap_err().to_string()
    };
    let turns = refused(|t, s| s.gyro_rad_s.z += if t >= 40.0 { 0.057 } else { 0.0 });
    assert!(
        turns.contains("at 140.000 s it turns at 3.3 °/s"),
        "{turns}"
    );
    let rolls = refused(|t, s| s.accel_m_s2.y += 0.5 * (0.3 * t).sin() * t.signum());
    assert!(rolls.contains("the direction of gravity"), "{rolls}");
    let falls = refused(|_, s| s.accel_m_s2.z = 0.1);
    assert!(falls.contains("not that of gravity"), "{falls}");
    let spins = refused(|_, s| s.gyro_rad_s.z += 0.2);
    assert!(spins.contains("it turns at 11"), "{spins}");
}

#[test]
fn knocks_and_gaps_are_reported() {
    let mut log = resting(82, 60);
    for sample in &mut log[2000..2010] {
        sample.accel_m_s2.z += 0.2;
    }
    let estimate = allan(&log).unwrap();
    assert_eq!(estimate.warnings.len(), 1, "{:?}", estimate.warnings);
    let knock = &estimate.warnings[0];
    assert!(
        knock.starts_with("1 of 60 seconds are noisier than the rest, the first at 120.000 s"),
        "{knock}"
    );

    let mut log = resting(83, 60);
    log.drain(1500..1510);
    let estimate = allan(&log).unwrap();
    assert_eq!((estimate.samples, estimate.span_s[0]), (4490, 115.1));
    assert!(
        estimate.warnings[0].contains("gaps"),
        "{:?}",
        estimate.warnings
    );
}

#[test]
fn bad_logs_are_errors() {
    let log = resting(84, 10);
    let message = |log: &[ImuSample]| allan(log).unwrap_err().to_string();
    assert!(message(&[]).contains("0 samples"));
    assert!(message(&log[..100]).contains("100 samples"));
    let mut bad = log.clone();
    bad[5].gyro_rad_s.x = f64::NAN;
    assert!(message(&bad).contains("not finite"));
    let mut bad = log.clone();
    bad[5].time_s = bad[4].time_s;
    assert!(message(&bad).contains("increase strictly"));
}
