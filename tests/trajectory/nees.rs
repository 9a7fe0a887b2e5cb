//! A small sample of many simulated drives: are the errors as large as the covariances say, with
//! the correlations of the components?

use super::twin::twin;
use boresight::geometry::{Rotation, Vec3};
use boresight::simulation::{Drive, Scenario, Scene};
use boresight::trajectory::{Estimate, PoseGradient};
use nalgebra::DVector;

const DRIVES: usize = 8;
const EPOCHS: usize = 20;

/// eᵀ Σ⁻¹ e of position, tilt and yaw of a node.
fn squares(found: &Estimate, truth: &[(Vec3, Rotation)], node: usize) -> [f64; 3] {
    let pose = found.trajectory.nodes()[node].world_from_body;
    let (position, rotation) = &truth[node];
    let turn = (pose.rotation * rotation.inverse()).scaled_axis();
    let shift = pose.translation.vector - position;
    // The rotation about the world's axes is world_from_body δφ.
    let r = pose.rotation.to_rotation_matrix();
    let mut gradient = PoseGradient::new(6, found.covariance.nodes());
    let block = gradient.block_mut(node);
    for axis in 0..3 {
        block[axis * 6 + 3 + axis] = 1.0;
        for column in 0..3 {
            block[(3 + axis) * 6 + column] = r[(axis, column)];
        }
    }
    let covariance = found.covariance.of_functional(&gradient);
    let error = DVector::from_vec(vec![shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]);
    [(0, 3), (3, 2), (5, 1)].map(|(from, count)| {
        let e = error.rows(from, count).into_owned();
        let c = covariance.view((from, from), (count, count)).into_owned();
        e.dot(&c.cholesky().expect("a covariance").solve(&e))
    })
}

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
            for (mean, square) in means.iter_mut().zip(squares(&found, &truth, node)) {
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
