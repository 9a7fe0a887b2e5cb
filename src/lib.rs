//! Calibrates laser profile scanners on a moving platform and validates the result.
//!
//! The method is that of Esser, Tombrink, Cornelißen, Klingbeil and Kuhlmann,
//! *System Calibration of a Field Phenotyping Robot with Multiple High-Precision Profile Laser
//! Scanners* (arXiv 2403.17788). The program `boresight` reads files and writes a report; the
//! library works on plain arrays as well. Lengths are in metres, angles in radians and times in
//! seconds; names carry units, and transforms carry their frames in their types.
//!
//! # Georeference a point
//!
//! x_m = t_mb + R_mb (t_bs + R_bs x_s), equation (1) of the paper:
//!
//! ```
//! use boresight::geometry::{BodyFromScanner, Rotation, Vec3, WorldFromBody};
//! use boresight::georeference::Georeferencer;
//! use boresight::sensor::{PoseRecord, ScanPoint};
//! use boresight::trajectory::Trajectory;
//!
//! // One metre per second to the east, two metres above the ground.
//! let at = |east_m| WorldFromBody::new(Rotation::identity(), Vec3::new(east_m, 0.0, 2.0));
//! let trajectory = Trajectory::new(vec![PoseRecord::new(0.0, at(0.0)), PoseRecord::new(2.0, at(2.0))])?;
//! let mounting = BodyFromScanner::new(Rotation::identity(), Vec3::new(1.2, -0.5, 0.0));
//! let mut georeferencer = Georeferencer::new(&trajectory, mounting, 0.0);
//! let position_m = Vec3::new(0.2, 0.0, -1.4);
//! let placed_m = georeferencer.place(&ScanPoint { time_s: 0.5, position_m, intensity: 0.0 });
//! assert!((placed_m.unwrap() - Vec3::new(1.9, -0.5, 0.6)).norm() < 1e-12);
//! # Ok::<(), boresight::Error>(())
//! ```
//!
//! # Smooth a drive
//!
//! Poses with standard deviations from IMU samples, positions of a prism and headings:
//!
//! ```
//! use boresight::geometry::BodyAxes;
//! use boresight::progress::Silent;
//! use boresight::trajectory::{
//!     HeadingSettings, ImuDatasheet, ImuNoise, MotionLogs, PositionSettings, TrajectorySettings,
//!     estimate,
//! };
//! # use boresight::simulation::{Drive, Scenario, Scene};
//! # let scenario = Scenario::demo();
//! # let drive = Drive::new(&scenario, &Scene::new(&scenario), 0, 0.0);
//! # let imu = boresight::simulation::simulate_imu(&scenario, &drive, 0).samples;
//! # let imu: Vec<_> = imu.into_iter().filter(|sample| sample.time_s < 60.0).collect();
//! # let prism = boresight::simulation::simulate_prism(&scenario, &drive, 0);
//! # let headings = boresight::simulation::simulate_heading(&scenario, &drive, 0);
//! # let lever_arm_m = scenario.lever_arm_m();
//!
//! // imu: Vec<ImuSample>, prism: Vec<PositionFix>, headings: Vec<HeadingFix>, lever_arm_m: Vec3
//! let settings = TrajectorySettings::new(
//!     BodyAxes::Frd,
//!     ImuNoise::from_datasheet(&ImuDatasheet {
//!         gyro_noise_deg_sqrt_h: 0.15,
//!         accel_noise_ug_sqrt_hz: 57.0,
//!         gyro_bias_instability_deg_h: 7.0,
//!         accel_bias_instability_ug: 14.0,
//!     }),
//!     PositionSettings::prism(0.005, lever_arm_m),
//!     HeadingSettings::aligned(0.7_f64.to_radians()),
//! );
//! let logs = MotionLogs { imu: &imu, positions: &[prism], heading: &headings };
//! let estimate = estimate(&logs, &settings, &Silent)?;
//! let world_from_body = estimate.trajectory.pose_at(30.0).expect("within the log");
//! # let truth = drive.at(30.0).world_from_body;
//! # assert!((world_from_body.translation_m - truth.translation_m).norm() < 0.01);
//! # Ok::<(), boresight::Error>(())
//! ```
//!
//! # Calibrate two scanners
//!
//! Mountings from the trajectory of the body, the points of a reference in the world, and each
//! scanner's times and points in its own frame:
//!
//! ```
//! use boresight::Result;
//! use boresight::calibration::{CalibrationSettings, Input, Mounting, ScannerSample, calibrate};
//! use boresight::progress::Silent;
//! # use boresight::geometry::{BodyFromScanner, Rotation, Vec3, WorldFromBody};
//! # use boresight::{sensor::PoseRecord, trajectory::Trajectory};
//! # // Two fans across the track look down on waves; four passes, out and back along x and y.
//! # let height = |x: f64, y: f64| 0.1 * (2.0 * x + y).sin() + 0.1 * (3.0 * y - x).cos();
//! # let pose_at = |time_s: f64| {
//! #     let (pass, along) = ((time_s / 10.0).floor(), (time_s % 10.0) / 5.0 - 1.0);
//! #     let yaw = pass * std::f64::consts::FRAC_PI_2;
//! #     let turn = Rotation::from_euler_angles(0.1 * time_s.sin(), 0.1 * (2.0 * time_s).cos(), yaw);
//! #     WorldFromBody::new(turn, Vec3::new(along * yaw.cos(), along * yaw.sin(), 2.0))
//! # };
//! # let truth = [-1.0, 1.0].map(|side: f64| {
//! #     let turn = Rotation::from_euler_angles(0.5 * side, 0.02, std::f64::consts::FRAC_PI_2);
//! #     BodyFromScanner::new(turn, Vec3::new(0.3, 0.5 * side, 0.1))
//! # });
//! # let scans = truth.map(|body_from_scanner| {
//! #     let (mut times_s, mut points_m) = (Vec::new(), Vec::new());
//! #     for (profile, beam) in (0..4000).flat_map(|profile| (-9..=9).map(move |beam| (profile, beam))) {
//! #         let time_s = 0.01 * f64::from(profile);
//! #         let world_from_scanner = pose_at(time_s) * body_from_scanner;
//! #         let angle = 0.05 * f64::from(beam);
//! #         let direction = Vec3::new(angle.sin(), 0.0, -angle.cos());
//! #         let range = (0..20).fold(2.0, |range, _| {
//! #             let hit = world_from_scanner.map(&(direction * range));
//! #             range + hit.z - height(hit.x, hit.y)
//! #         });
//! #         times_s.push(time_s);
//! #         points_m.push(direction * range);
//! #     }
//! #     (times_s, points_m)
//! # });
//! # let reference: Vec<Vec3> = (0..40_000)
//! #     .map(|i| (f64::from(i % 200) * 0.025 - 2.5, f64::from(i / 200) * 0.025 - 2.5))
//! #     .map(|(x, y)| Vec3::new(x, y, height(x, y)))
//! #     .collect();
//! # let times_s = (0..=4000).map(|i| 0.01 * f64::from(i));
//! # let poses = times_s.map(|time_s| PoseRecord::new(time_s, pose_at(time_s)));
//! # let trajectory = Trajectory::new(poses.collect())?;
//! # let off = |pose: &BodyFromScanner| pose.perturbed(&Vec3::new(0.01, -0.01, 0.01), &Vec3::repeat(0.02));
//! # let [left, right] = truth.each_ref().map(off);
//!
//! // left, right: BodyFromScanner to start from; scans: times_s, Vec<f64>, and points_m, Vec<Vec3>
//! let settings = CalibrationSettings {
//!     voxel_sizes_m: vec![0.1, 0.05],
//!     ..Default::default()
//! };
//! let mountings = vec![Mounting::new("left", left), Mounting::new("right", right)];
//! let thinned = mountings.iter().zip(&scans).map(|(mounting, (times_s, points_m))| {
//!     ScannerSample::from_points(mounting, times_s, points_m, &trajectory, &settings)
//! });
//! let samples = thinned.collect::<Result<Vec<_>>>()?;
//! let input = Input::new(mountings, &samples, &trajectory).with_reference(&reference);
//! let calibration = calibrate(&input, &settings, &Silent)?;
//! println!("{}", serde_json::to_string(&calibration.scanners())?); // with standard deviations
//! # assert!(calibration.converged);
//! # for (pose, truth) in calibration.poses().iter().zip(&truth) {
//! #     assert!((pose.translation_m - truth.translation_m).norm() < 2e-3);
//! # }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Compare two clouds
//!
//! M3C2 distances: signed, along local normals, with their level of detection:
//!
//! ```
//! use boresight::comparison::{ComparisonSettings, Normals, Statistics, core_points, m3c2};
//! use boresight::progress::Silent;
//! # use boresight::geometry::Vec3;
//! # let plane = |up_m: f64| -> Vec<Vec3> {
//! #     let grid = (0..10_000).map(|i| (f64::from(i % 100), f64::from(i / 100)));
//! #     grid.map(|(x, y)| Vec3::new(0.005 * x, 0.005 * y, up_m)).collect()
//! # };
//! # let (reference, cloud) = (plane(0.0), plane(0.003));
//!
//! // reference: Vec<Vec3>, cloud: Vec<Vec3>, 3 mm above it
//! let settings = ComparisonSettings::default();
//! let core = core_points(&reference, &settings);
//! let distances = m3c2(&reference, &cloud, &core, Normals::UPWARDS, &settings, &Silent)?;
//! let statistics = Statistics::of(&distances)?;
//! assert!((statistics.mean_m - 0.003).abs() < 1e-12);
//! # Ok::<(), boresight::Error>(())
//! ```
//!
//! # How it is built
//!
//! Data flows down this list, and modules import only from above:
//!
//! | module | contents |
//! |---|---|
//! | [`error`] | the error type, with file, line and remedy |
//! | [`progress`] | progress of stages, cancellation |
//! | [`output`] | result files, written completely or not at all |
//! | [`statistics`] | median, quantiles, χ², F, Student's t, series in time |
//! | [`geometry`] | rotations, rigid transforms, Euler conventions, headings |
//! | [`sensor`] | measurements of each sensor, validated |
//! | [`cloud`] | points, voxel grid, nearest neighbours, structure tensor, omnivariance |
//! | [`mod@format`] | readers and writers, one file per format; detection |
//! | [`adjustment`] | least squares on a chain with border: normal equations, covariances, losses |
//! | [`trajectory`] | states, factors, graph, batch and online smoother, diagnostics, interpolation |
//! | [`trajectory_error`] | absolute and relative errors of a trajectory against a reference |
//! | [`georeference`] | x_m = t_mb + R_mb (t_bs + R_bs x_s) |
//! | [`surface`] | neighbourhoods and their planes, derivatives by pose and by mounting |
//! | [`calibration`] | parameters, cost, adjustment, scales, observability, uncertainty |
//! | [`preflight`] | mistakes that raw logs and the first placement of the scans show |
//! | [`joint`] | one adjustment of trajectory and mountings: surfels, scan factors, tests of the model |
//! | [`drift`] | drift watch: one scanner against the other from the field's overlap, control chart |
//! | [`comparison`] | M3C2 and its statistics |
//! | [`tiles`] | clouds larger than memory: features, M3C2, thinning |
//! | [`simulation`] | scene, drives and sensors with known truth; does not use the estimators |
//! | [`verdict`] | statements about results, with severity and code |
//! | [`results`] | results of the stages, before they are judged or shown |
//! | [`number`] | values as text: significant digits, lengths with their unit |
//! | [`diagnostics`] | numbers on an adjusted trajectory: sigmas of poses, residuals, rejections |
//! | [`judgement`] | results turned into verdicts, each once |
//! | [`report`] | tables, figures, the page |
//! | [`project`] | `project.toml`: parsing and validation |
//! | [`feed`] | the records of a drive in common time, with the origin subtracted |
//! | [`pipeline`] | the stages in order |
//! | [`campaign`] | many plots and dates as items, a pool of processes, index and page |
//! | [`record`] | sensors while driving: total stations by GeoCOM, sensors that send on their own; live pose, replay |
//! | [`cli`] | the command line, one file per command |

pub mod campaign;
#[cfg(feature = "cli")]
pub mod cli;
pub mod pipeline;

pub use boresight_cloud::{Error, Problem, Result, nalgebra};
pub use boresight_cloud::{cloud, comparison, error, geometry, output, progress, statistics};
pub use boresight_estimation::{
    adjustment, calibration, drift, georeference, joint, preflight, surface, trajectory,
    trajectory_error,
};
pub use boresight_format::{format, sensor, tiles};
pub use boresight_project::{feed, project};
pub use boresight_record::record;
pub use boresight_report::{diagnostics, judgement, number, report, results, verdict};
pub use boresight_simulation::simulation;
