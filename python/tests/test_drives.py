"""Trajectories from logs in memory, and their covariances."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pytest

import boresight
from boresight import plot
from conftest import DATA


def sensor_logs(drive):
    folder = drive.projects[0].parent
    return {
        name: boresight.read(folder / f"{file}.csv", name)
        for name, file in {"imu": "imu", "positions": "prism", "heading": "heading"}.items()
    }


def of_logs(drive, **changed):
    import tomllib

    project = tomllib.loads(drive.projects[0].read_text())
    arguments = {
        **sensor_logs(drive),
        "lever_arm_m": project["prism"]["lever_arm_m"],
        "sigma_position_m": project["prism"]["sigma_m"],
        "sigma_heading_deg": project["heading"]["sigma_deg"],
        "progress": None,
    }
    return boresight.smooth(**(arguments | changed))


def test_logs_give_the_trajectory_of_the_project(drive):
    ours, theirs = of_logs(drive), boresight.smooth(drive.projects[0], progress=None)
    for name in ours.poses.dtype.names:
        assert np.array_equal(ours.poses[name], theirs.poses[name], equal_nan=True), name
    truth = boresight.read(drive.projects[0].parent / "truth" / "trajectory.csv")
    at = np.searchsorted(truth["time_s"], ours.times_s[100:-100])
    off = ours.poses["position_m"][100:-100] - truth["position_m"][at]
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.005
    # Frames of pandas are logs too.
    frames = {name: boresight.to_pandas(log) for name, log in sensor_logs(drive).items()}
    assert np.array_equal(of_logs(drive, **frames).poses, ours.poses) or (
        of_logs(drive, **frames).poses.tobytes() == ours.poses.tobytes()
    )


def test_headings_may_be_left_out_and_records_out_of_order_are_said(drive):
    without = of_logs(drive, heading=None)
    assert len(without) == len(of_logs(drive))
    imu = sensor_logs(drive)["imu"].copy()
    imu[[100, 101]] = imu[[101, 100]]
    with pytest.warns(boresight.BoresightWarning, match="1 record of imu is excluded: time out of order"):
        of_logs(drive, imu=imu)
    with pytest.raises(boresight.TooFewError, match="0 samples"):
        of_logs(drive, imu=imu[:0])


def test_large_coordinates_cost_no_digits(drive):
    shift = np.array([364_000.0, 5_621_000.0, 60.0])
    positions = sensor_logs(drive)["positions"].copy()
    positions["position_m"] += shift
    near, far = of_logs(drive), of_logs(drive, positions=positions)
    assert np.allclose(far.poses["position_m"] - shift, near.poses["position_m"], rtol=0, atol=1e-6)


def test_covariances_belong_to_the_sigmas(drive):
    trajectory = boresight.smooth(drive.projects[0], progress=None)
    joint = trajectory.covariance([100, 105, -1])
    assert joint.shape == (18, 18) and np.allclose(joint, joint.T, rtol=1e-9, atol=1e-18)
    assert np.linalg.eigvalsh(joint).min() > -1e-15
    alone = trajectory.covariance(100)
    assert np.allclose(alone, joint[:6, :6], rtol=1e-9)
    sigma = trajectory.poses[100]
    assert np.allclose(np.sqrt(np.diag(alone))[3:], sigma["sigma_position_m"], rtol=0.05)
    # Neighbours in time are strongly correlated.
    assert joint[3, 9] / np.sqrt(joint[3, 3] * joint[9, 9]) > 0.9
    with pytest.raises(IndexError):
        trajectory.covariance(len(trajectory))
    copy = pickle.loads(pickle.dumps(trajectory))
    assert copy.poses.tobytes() == trajectory.poses.tobytes() and copy.to_dict() == trajectory.to_dict()
    with pytest.raises(ValueError, match="another process"):
        copy.covariance(0)
    assert trajectory.rotations[100].magnitude() >= 0.0
    assert trajectory.to_dict()["converged"] and "prism" in trajectory._repr_html_()


def without_times(document):
    """A document without what differs between runs."""
    if isinstance(document, dict):
        return {key: without_times(value) for key, value in document.items() if key != "seconds"}
    return [without_times(value) for value in document] if isinstance(document, list) else document


@pytest.mark.long
def test_calibrate_finds_what_a_run_finds(tmp_path):
    drive = boresight.simulate(DATA / "tiny_scenario.toml", tmp_path / "simulated", progress=None)
    project = drive.projects[0]
    # The simulated ground is too small for larger surfels.
    text = re.sub(r"^voxel_sizes_m = .*$", "voxel_sizes_m = [0.05]", project.read_text(), flags=re.M)
    project.write_text(text + "\n[joint]\nsurfel_m = 0.2\n")
    found = boresight.calibrate(project, tmp_path / "alone", progress=None)
    whole = boresight.run(project, tmp_path / "run", progress=None)
    ours, theirs = (without_times(result.to_dict()) for result in (found, whole))
    assert ours["calibration"]["method"] == "joint" and "joint" in ours["calibration"]
    for key in ("scanners", "calibration", "trajectory", "two_steps"):
        assert ours.get(key) == theirs.get(key), key
    assert (tmp_path / "alone" / "mounting.csv").read_bytes() == (tmp_path / "run" / "mounting.csv").read_bytes()
    before = boresight.calibrate(project, tmp_path / "before", method="two-step", progress=None).to_dict()
    assert before["calibration"]["method"] == "two-step" and "joint" not in before["calibration"]


def test_calibrate(drive, tmp_path):
    found = boresight.calibrate(drive.projects[0], tmp_path, progress=None)
    assert [path.name for path in found.files] == ["calibration.toml", "mounting.csv", "calibration.html"]
    assert all(path.exists() for path in found.files)
    assert set(found.mountings) == {"left", "right"} and found.covariance is not None
    assert found.to_dict()["scanners"] and found.verdicts and "scanner" in found._repr_html_()
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    assert plot.correlation(found) is not None
    assert plot.track(boresight.smooth(drive.projects[0], progress=None)) is not None
    with pytest.raises(ValueError, match="method is"):
        boresight.calibrate(drive.projects[0], tmp_path / "wrong", method="jiont", progress=None)
    with pytest.raises(boresight.FormatError, match="force=True"):
        boresight.simulate("plain", drive.projects[0].parents[1], progress=None)
