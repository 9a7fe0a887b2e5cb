//! Commands on clouds in feet, and on clouds with a point far from the others.

use super::case;
use boresight::format::{CLOUD_STEP_M, read_cloud};

use crate::common::boresight;

#[test]
fn a_far_point_does_not_coarsen_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let input = case("outlier_coarsens_laz/z0.csv");
    let input = input.to_str().unwrap();
    let out = at("out");
    for arguments in [
        &["convert", input, &at("a.laz")][..],
        &["convert", input, &at("a.las")],
        &["convert", input, &at("a.copc.laz")],
        &["thin", input, "--voxel-m", "0.1", "--out", &out],
        &["features", input, "--neighbours", "3", "--out", &out],
    ] {
        let run = boresight(arguments);
        let is_refused = run.code != 0 && run.err.contains("the point (0, 0, 0) m");
        assert!(is_refused, "{arguments:?}: {}", run.err);
    }
    // Without it the step is that which is promised; other formats hold all points.
    let near = at("near.csv");
    let text = std::fs::read_to_string(input).unwrap();
    std::fs::write(&near, text.replace("0,0,0,0\n", "")).unwrap();
    for output in [at("b.laz"), at("b.copc.laz")] {
        assert_eq!(boresight(&["convert", &near, &output]).code, 0);
        let found = read_cloud(&output).unwrap();
        let expected = read_cloud(&near).unwrap();
        for point in &expected.points {
            let nearest = found.points.iter().map(|p| (p - point).amax());
            assert!(nearest.fold(1.0, f64::min) < 0.51 * CLOUD_STEP_M);
        }
    }
    assert_eq!(boresight(&["convert", input, &at("a.ply")]).code, 0);
    assert_eq!(
        read_cloud(&folder.path().join("a.ply"))
            .unwrap()
            .points
            .len(),
        4
    );
}

#[test]
fn clouds_in_feet_are_compared_in_metres() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let [a, b] = ["a.las", "b.las"].map(|name| case(&format!("compare-feet/{name}")));
    let [a, b] = [a.to_str().unwrap(), b.to_str().unwrap()];
    let run = boresight(&["compare", b, a, "--out", out]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(
        run.out.contains("mean                 15.24 mm"),
        "{}",
        run.out
    );
    assert!(
        run.err.contains("from the unit foot of 0.3048 m"),
        "{}",
        run.err
    );
    // The core points keep the coordinate system, and so its unit.
    let core = folder.path().join("m3c2.laz");
    let core = read_cloud(&core).unwrap();
    let whole = read_cloud(std::path::Path::new(a)).unwrap();
    assert!((core.points[0] - whole.points[0]).norm() < 1.0);
    // Sizes are metres in all commands: 0.1 m are 0.33 ft.
    let run = boresight(&["thin", a, "--voxel-m", "0.1", "--out", out]);
    assert!(run.err.contains("from the unit foot"), "{}", run.err);
    let thinned = read_cloud(&folder.path().join("a-thinned.laz")).unwrap();
    assert!(thinned.points.len() < 60, "{}", thinned.points.len());
    let run = boresight(&["features", a, "--neighbours", "10", "--out", out]);
    assert!(run.err.contains("from the unit foot"), "{}", run.err);
}

#[test]
fn clouds_in_degrees_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    let mut bytes = std::fs::read(case("compare-feet/a.las")).unwrap();
    let system = bytes.windows(8).position(|w| w == b"PROJCRS[").unwrap();
    // The description of a geographic system, filled up with blanks.
    let length = u16::from_le_bytes(bytes[system - 34..system - 32].try_into().unwrap());
    let text = format!(
        "{:1$}",
        r#"GEOGCRS["WGS 84",ID["EPSG",4326]]"#,
        usize::from(length)
    );
    bytes[system..system + usize::from(length)].copy_from_slice(text.as_bytes());
    std::fs::write(&path, bytes).unwrap();
    let (path, out) = (path.to_str().unwrap(), folder.path().to_str().unwrap());
    for arguments in [
        &["thin", path, "--voxel-m", "0.1", "--out", out][..],
        &["compare", path, path, "--out", out],
        &["features", path, "--neighbours", "10", "--out", out],
    ] {
        let run = boresight(arguments);
        let is_refused = run.code != 0 && run.err.contains("latitudes and longitudes");
        assert!(is_refused, "{arguments:?}: {}", run.err);
    }
}
