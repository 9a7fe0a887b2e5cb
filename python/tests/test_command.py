"""Numbers equal to those of the command, to the last bit."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import boresight


def equal(a, b) -> bool:
    """Whether two arrays are equal bit by bit; NaN is equal to NaN."""
    a, b = np.ascontiguousarray(a), np.ascontiguousarray(b)
    return a.dtype == b.dtype and a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


@pytest.mark.parametrize("how", [{}, {"neighbours": 20}, {"radius_m": 0.05}])
def test_features(command, field, tmp_path, how):
    arguments = [f"--{key.replace('_', '-')}={value}" for key, value in how.items()]
    command("features", field, "--features", "all", "--out", tmp_path, *arguments)
    written = boresight.read(tmp_path / "field-features.laz").attributes
    found = boresight.features(boresight.read(field), features="all", progress=None, **how)
    assert len(found.dtype.names) == 14
    for name in found.dtype.names:
        # The file has 32 bits, which come back as 64.
        assert equal(found[name].astype(written[name].dtype), written[name]), name
    assert np.isfinite(found["planarity"]).mean() > 0.9


def test_default_features_are_those_of_the_command(command, field, tmp_path):
    command("features", field, "--out", tmp_path)
    written = boresight.read(tmp_path / "field-features.laz").attributes
    found = boresight.features(boresight.read(field), progress=None)
    assert [name for name in written if name not in ("time_s", "intensity")] == list(found.dtype.names)


def test_thin(command, field, tmp_path):
    command("thin", field, "--voxel-m", "0.05", "--out", tmp_path)
    written = boresight.read(tmp_path / "field-thinned.laz")
    cloud = boresight.read(field)
    kept = cloud[boresight.thin(cloud, 0.05, progress=None)]
    assert 0 < len(kept) < len(cloud) / 5
    assert equal(kept.points, written.points)
    assert all(equal(kept.attributes[name], written.attributes[name]) for name in ("time_s", "intensity"))


OPTIONS = {
    "default": ([], {}),
    "radii": (["--normal-radii-m", "0.03,0.06"], {"normal_radii": [0.03, 0.06]}),
    "robust": (["--robust"], {"robust_aggr": True}),
    "student": (["--student", "--min-points", "3"], {"student": True, "min_points": 3}),
    "direction": (["--direction", "0,0.1,1"], {"direction": [0, 0.1, 1]}),
    "one-sided": (["--one-sided", "--orientation=0,0,-1"], {"one_sided": True, "orientation_vector": [0, 0, -1]}),
    "registration": (["--registration-error-m", "0.002"], {"registration_error": 0.002}),
    "spacing": (["--core-spacing-m", "0.05"], {"corepoint_spacing_m": 0.05}),
}


STATISTICS = (
    "n",
    "core_points",
    "mean_m",
    "std_m",
    "m3c2_rmse_m",
    "median_m",
    "nmad_m",
    "significant_share",
)


@pytest.mark.parametrize("case", OPTIONS)
def test_m3c2(command, field, tmp_path, case):
    options, arguments = OPTIONS[case]
    first = boresight.read(field)
    later = tmp_path / "later.laz"
    rng = np.random.default_rng(8)
    boresight.write(later, first.points[::2] + [0.0, 0.0, 0.003] + rng.normal(0.0, 1e-3, (len(first) // 2, 3)))
    printed = command("compare", later, field, "--out", tmp_path / "out", "--json", *options)
    found = boresight.m3c2(first, boresight.read(later), progress=None, **arguments)
    assert np.isfinite(found.distances).mean() > 0.1
    columns = {
        "east_m": found.corepoints[:, 0],
        "north_m": found.corepoints[:, 1],
        "up_m": found.corepoints[:, 2],
        "normal_x": found.normals[:, 0],
        "normal_y": found.normals[:, 1],
        "normal_z": found.normals[:, 2],
        "normal_radius_m": found.normal_radii,
        "distance_m": found.distances,
        "level_of_detection_m": found.uncertainties["lodetection"],
        "reference_spread_m": found.uncertainties["spread1"],
        "compared_spread_m": found.uncertainties["spread2"],
        "reference_count": found.uncertainties["num_samples1"],
        "compared_count": found.uncertainties["num_samples2"],
    }
    # The table has every digit.
    with open(tmp_path / "out" / "m3c2.csv", newline="") as table:
        rows = list(csv.DictReader(table))
    for name, values in columns.items():
        written = np.array([float(row[name] or "nan") for row in rows])
        assert equal(values.astype(np.float64), written), name
    theirs = json.loads(printed)
    assert found.to_dict() == {name: theirs[name] for name in STATISTICS}


def test_georeference_and_smooth(command, drive, tmp_path):
    project = drive.projects[0]
    command("trajectory", project, "--out", tmp_path)
    command("georeference", project, "--out", tmp_path)
    poses = boresight.read(tmp_path / "trajectory.csv")
    smoothed = boresight.smooth(project, progress=None)
    assert len(smoothed) == len(poses) > 1000
    for name in ("time_s", "position_m", "quaternion_xyzw", "sigma_position_m"):
        # The table has so many digits that values come back as they were; angles go through degrees.
        assert np.allclose(smoothed.poses[name], poses[name], rtol=1e-12, atol=1e-12, equal_nan=True), name
    scanners = mountings(project)
    assert scanners
    for name, mounting in scanners.items():
        scan = boresight.read(project.parent / f"{name}.bin", "profiles")
        placed = boresight.georeference(scan["position_m"], scan["time_s"], smoothed, mounting, progress=None)
        written = boresight.read(tmp_path / f"cloud-{name}.laz")
        known = np.isfinite(placed[:, 0])
        assert known.sum() == len(written) > 10_000
        # The file has steps of 10 µm.
        assert equal(np.rint(1e5 * placed[known]), np.rint(1e5 * written.points))
        assert equal(scan["time_s"][known], written.attributes["time_s"])
    clouds = boresight.georeference_project(project, tmp_path / "python", progress=None).clouds
    assert clouds
    for cloud in clouds:
        assert cloud.read_bytes() == (tmp_path / cloud.name).read_bytes()


def mountings(project) -> dict[str, boresight.Mounting]:
    """The mountings of a simulated project."""
    text = project.read_text()
    found = {}
    for block in text.split("[[scanner]]")[1:]:
        name = re.search(r'name = "(.*)"', block).group(1)
        place = json.loads(re.search(r"translation_m = (\[.*\])", block).group(1))
        angles = json.loads(re.search(r"rotation_deg = (\[.*\])", block).group(1))
        assert 'rotation_convention = "bonn"' in block
        turn = Rotation.from_euler("xyz", angles, degrees=True).inv()
        found[name] = boresight.Mounting(turn, place)
    return found


def test_calibrate_and_run(command, drive, tmp_path):
    project = drive.projects[0]
    command("run", project, "--out", tmp_path / "command")
    run = boresight.run(project, tmp_path / "python", progress=None)
    theirs = json.loads((tmp_path / "command" / "result.json").read_text())
    ours = json.loads((tmp_path / "python" / "result.json").read_text())
    assert run.to_dict()["scanners"] == ours["scanners"] == theirs["scanners"]
    assert ours["calibration"]["covariance"] == theirs["calibration"]["covariance"]
    for name in ("calibration.toml", "trajectory.csv", *(cloud.name for cloud in run.clouds)):
        assert (tmp_path / "python" / name).read_bytes() == (tmp_path / "command" / name).read_bytes(), name
    assert run.report.exists() and run.clouds and run.headline
    calibration = run.calibration
    size = len(calibration.parameters)
    assert calibration.covariance.shape == calibration.correlation.shape == (size, size) and size % 6 == 0
    assert np.allclose(calibration.covariance, calibration.covariance.T, equal_nan=True)
    for name, mounting in calibration.mountings.items():
        assert mounting.sigma_translation_m.shape == (3,)
        at = calibration.parameters.index(f"{name}.tx")
        known = np.isfinite(mounting.sigma_translation_m)
        variance = np.diag(calibration.covariance)[at : at + 3]
        assert np.allclose(mounting.sigma_translation_m[known] ** 2, variance[known], rtol=1e-6)
        assert known.all() or calibration.undetermined
    assert "<table>" in run._repr_html_() and "±" in calibration._repr_html_()
