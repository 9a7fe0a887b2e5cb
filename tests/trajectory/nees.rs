//! A small sample of many simulated drives: are the errors as large as the covariances say, with
//! the correlations of the components?

use super::consistency::squares;
use super::twin::twin;
use boresight::simulation::{Drive, Scenario, Scene};

const DRIVES: usize = 8;
const EPOCHS: usize = 20;

/// Bounds of χ² that hold 99.9 % (Wilson and Hilferty 1931).
fn band(degrees: f64) -> [f64; 2] {
    let spread = 2.0 / (9.0 * degrees);
    [-3.29, 3.29].map(|z| degrees * (1.0 - spread + z * spread.sqrt()).powi(3))
}

#[test]
fn normalised_squared_errors_are_as_many_as_the_degrees_of_freedom() {
    let mut scenario = Scenario::demo();
    let scene = Scene::new(&scenario);
    let paths: Vec<Drive> = (0..scenario.drives.len())
        .map(|index| Drive::new(&scenario, &scene, index, 0.0))
        .collect();
    let mut means = [0.0; 3];
    for seed in 0..DRIVES {
        let index = seed % paths.len();
        scenario.seed = 900 + seed as u64;
        let (logs, truth) = twin(&scenario, &paths[index], index);
        let found = logs.estimate();
        let nodes = found.trajectory.nodes().len();
        for epoch in 0..EPOCHS {
            let node = (2 * epoch + 1) * nodes / (2 * EPOCHS);
            let squares = squares(&found, &truth, node).expect("a covariance");
            for (mean, square) in means.iter_mut().zip(squares) {
                *mean += square / (DRIVES * EPOCHS) as f64;
            }
        }
    }
    for ((name, degrees), mean) in [("position", 3.0), ("tilt", 2.0), ("yaw", 1.0)]
        .iter()
        .zip(means)
    {
        // The errors of yaw and tilt at the epochs of one drive hang together, so that the mean
        // over them may scatter as one draw does: no fewer than the drives are independent.
        let [low, high] = band(degrees * DRIVES as f64).map(|x| x / DRIVES as f64);
        println!("{name}: mean {mean:.3} of {degrees}, band {low:.2} to {high:.2}");
        assert!((low..=high).contains(&mean), "{name}: {mean}");
    }
}
