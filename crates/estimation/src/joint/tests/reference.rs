//! The reference's prior of a surfel.

use super::case::Case;
use crate::geometry::Vec3;
use crate::joint::state::State;

#[test]
fn a_reference_that_moves_along_a_sloping_surfel_rises_with_it() {
    let case = Case::from_file();
    let input = case.input();
    let (problem, mut state) = case.problem(&input);
    let mut surfels = problem.association.surfels.iter();
    let (surfel, prior) = surfels
        .find_map(|surfel| Some((surfel, surfel.prior.as_ref()?)))
        .expect("a reference");
    let shape = Vec3::new(1e-4, 0.01, -0.02);
    let rows = |state: &State| problem.reference_rows(surfel, prior, &shape, state);
    let before = rows(&state);
    // By 10 mm and 20 mm along the surfel's axes: its plane is 0.3 mm lower there.
    let along_m = surfel.axes[1] * 0.01 + surfel.axes[2] * 0.02;
    state.reference[..3].copy_from_slice(along_m.as_slice());
    let after = rows(&state);
    let risen_m = (after[0].residual - before[0].residual) / after[0].weight;
    assert!((risen_m + 3e-4).abs() < 1e-12, "{risen_m}");
    for slope in 1..3 {
        assert!((after[slope].residual - before[slope].residual).abs() < 1e-12);
    }
}
