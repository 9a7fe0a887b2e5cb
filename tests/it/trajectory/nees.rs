//! Normalised estimation errors squared over a few simulated drives, which judge the covariances
//! together with the correlations of their components.

use crate::common::consistency::{EPOCHS, band, squares_at_epochs, twin};
use boresight::simulation::{Drive, Scenario, Scene};

const DRIVES: usize = 8;

/// Means over drives of three passes whose scenario is changed, of position, tilt and yaw.
fn mean_squares(change: impl Fn(&mut Scenario)) -> [f64; 3] {
    let mut scenario = Scenario::demo();
    let drives = scenario.drives.iter_mut();
    drives.for_each(|drive| drive.passes.truncate(3));
    change(&mut scenario);
    let scene = Scene::new(&scenario);
    let paths: Vec<Drive> = (0..scenario.drives.len())
        .map(|index| Drive::new(&scenario, &scene, index, 0.0))
        .collect();
    let mut means = [0.0; 3];
    for seed in 0..DRIVES {
        let index = seed % paths.len();
        scenario.seed = 900 + seed as u64;
        let (logs, truth) = twin(&scenario, &paths[index], index);
        let estimate = logs.estimate();
        for squares in squares_at_epochs(&estimate, &truth).expect("covariances") {
            for (mean, square) in means.iter_mut().zip(squares) {
                *mean += square / (DRIVES * EPOCHS) as f64;
            }
        }
    }
    means
}

fn assert_consistent(means: [f64; 3]) {
    for ((name, degrees), mean) in [("position", 3.0), ("tilt", 2.0), ("yaw", 1.0)]
        .iter()
        .zip(means)
    {
        // The errors of yaw and tilt at the epochs of one drive are correlated, so that their mean may
        // scatter like a single draw: at least as many are independent as there are drives. 99.9 % lie
        // within the band.
        let [low, high] = band(*degrees, DRIVES as f64, 3.29);
        println!("{name}: mean {mean:.3} of {degrees}, band {low:.2} to {high:.2}");
        assert!((low..=high).contains(&mean), "{name}: {mean}");
    }
}

#[test]
fn the_mean_of_normalised_squared_errors_is_the_number_of_degrees_of_freedom() {
    assert_consistent(mean_squares(|_| {}));
}

fn with_lasting_errors(scenario: &mut Scenario) {
    scenario.prism.sigma_correlated_m = 0.02;
    scenario.prism.correlation_s = 20.0;
    scenario.heading.sigma_correlated_deg = 0.5;
    scenario.heading.correlation_s = 20.0;
}

/// Without a model of errors that last, positions would be off by tens of their standard deviations.
#[test]
fn covariances_hold_stated_errors_of_positions_and_headings_that_last() {
    assert_consistent(mean_squares(with_lasting_errors));
}

/// Five and a half minutes of errors that last for 20 s have 350 modes that stand out, more than are estimated.
#[test]
fn errors_that_last_are_not_blamed_on_the_imu() {
    let mut scenario = Scenario::demo();
    with_lasting_errors(&mut scenario);
    let scene = Scene::new(&scenario);
    let drive = Drive::new(&scenario, &scene, 0, 0.0);
    let (logs, _) = twin(&scenario, &drive, 0);
    let estimate = logs.estimate();
    assert_eq!(estimate.solution.imu_noise_factor(), 1.0);
}
