"""Reading and writing."""

from __future__ import annotations

import numpy as np
import pytest

import boresight
from conftest import DATA


@pytest.mark.parametrize("end", ["laz", "las", "copc.laz", "e57", "ply", "parquet", "csv"])
def test_clouds_come_back(tmp_path, end):
    rng = np.random.default_rng(1)
    points = np.round(rng.uniform(0.0, 5.0, (2_000, 3)), 4) + [364_000.0, 5_621_000.0, 60.0]
    attributes = {
        "time_s": 1.7e9 + np.round(np.linspace(0.0, 9.0, 2_000), 3),
        "intensity": rng.integers(0, 2**16, 2_000).astype(np.float32),
        "planarity": rng.random(2_000).astype(np.float32),
        "label": rng.integers(0, 9, 2_000).astype(np.uint32),
    }
    path = tmp_path / f"cloud.{end}"
    boresight.write(path, boresight.Cloud(points, attributes))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    read = boresight.read(path, "cloud")
    order = np.argsort(read.attributes["time_s"]) if "time_s" in read.attributes else np.arange(2_000)
    if end == "copc.laz":
        # In the order of the octree: told apart by its times, of which no two are equal but for rounding.
        order = np.lexsort((read.points[:, 0], read.attributes["time_s"]))
        mine = np.lexsort((points[:, 0], attributes["time_s"]))
    else:
        order = mine = np.arange(2_000)
    assert np.allclose(read.points[order], points[mine], rtol=0, atol=1e-5)
    for name, values in read.attributes.items():
        assert np.allclose(values[order], attributes[name][mine], rtol=0, atol=1e-6), name
    assert {"time_s", "intensity"} <= set(read.attributes) or end in ("ply", "e57")


def logs() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(2)
    found = {}
    for kind, dtype in {
        "trajectory": boresight.TRAJECTORY,
        "imu": boresight.IMU,
        "positions": boresight.POSITIONS,
        "heading": boresight.HEADING,
        "profiles": boresight.PROFILES,
    }.items():
        log = rng.normal(size=(50, dtype.itemsize // 8)).view(dtype).reshape(-1)
        log["time_s"] = np.arange(50.0)
        found[kind] = log
    turns = found["trajectory"]["quaternion_xyzw"]
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    turns *= np.sign(turns[:, 3])[:, None]
    for name in ("sigma_position_m", "sigma_rotation_rad"):
        found["trajectory"][name] = np.abs(found["trajectory"][name])
    root = found["positions"]["covariance_m2"]
    found["positions"]["covariance_m2"] = root @ root.transpose(0, 2, 1)
    for name in ("sigma_rad", "pitch_sigma_rad"):
        found["heading"][name] = np.abs(found["heading"][name])
    found["heading"]["pitch_rad"] *= 0.1
    found["heading"]["heading_rad"] = np.mod(found["heading"]["heading_rad"], 2 * np.pi)
    found["profiles"]["position_m"][:, 1] = 0.0
    found["profiles"]["intensity"] = np.arange(50.0)
    return found


@pytest.mark.parametrize("end", ["csv", "parquet"])
@pytest.mark.parametrize("kind", ["trajectory", "imu", "positions", "heading", "profiles"])
def test_logs_come_back(tmp_path, kind, end):
    log, path = logs()[kind], tmp_path / f"log.{end}"
    # By the fields, from a frame and from a mapping.
    boresight.write(path, log, None)
    first = path.read_bytes()
    read = boresight.read(path, kind)
    assert read.dtype == log.dtype and read.shape == log.shape
    for name in log.dtype.names:
        if np.isnan(read[name]).all():
            continue
        assert np.allclose(read[name], log[name], rtol=1e-9, atol=1e-9), name
    assert not np.isnan(read["time_s"]).any()
    boresight.write(path, boresight.to_pandas(log), kind)
    assert path.read_bytes() == first
    boresight.write(path, {name: log[name] for name in log.dtype.names}, kind)
    assert path.read_bytes() == first


def test_a_trajectory_becomes_tum_and_sbet(tmp_path):
    log = logs()["trajectory"]
    log["position_m"] += [364_000.0, 5_621_000.0, 60.0]
    boresight.write(tmp_path / "a.tum", log)
    assert np.allclose(boresight.read(tmp_path / "a.tum")["position_m"], log["position_m"], rtol=0, atol=1e-6)
    with pytest.raises(boresight.DataError, match="latitudes"):
        boresight.write(tmp_path / "a.sbet", log)
    assert not (tmp_path / "a.sbet").exists()
    boresight.write(tmp_path / "a.sbet", log, crs="EPSG:25832")
    back = boresight.read(tmp_path / "a.sbet", axes="FLU", crs="EPSG:25832")
    assert np.allclose(back["position_m"], log["position_m"], rtol=0, atol=1e-4)


def test_formats_are_told():
    assert boresight.detect(DATA / "autzen_m3c2" / "autzen-bmx-2010.las")[1][0] == "cloud"
    cloud = boresight.read(DATA / "autzen_m3c2" / "autzen-bmx-2010.las")
    assert len(cloud) > 500 and "intensity" in cloud.attributes
    assert "lowest" in cloud._repr_html_() and cloud.to_dict()["points"] == len(cloud)
    assert len(cloud[:10]) == 10 and len(cloud[cloud.points[:, 2] > 0]) <= len(cloud)


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.laz"
    boresight.write(path, np.zeros((5, 3)) + 1.0)
    old = path.read_bytes()
    with pytest.raises(boresight.Error):
        boresight.write(path, np.array([[0.0, 0.0, np.nan]]))
    assert path.read_bytes() == old and [entry.name for entry in tmp_path.iterdir()] == ["a.laz"]


def test_mountings_are_those_of_the_command(tmp_path, drive, command):
    project = drive.projects[0]
    mountings = boresight.read(project)
    assert list(mountings) == ["left", "right"]
    for end in ["urdf", "launch.py", "yaml"]:
        expected, written = tmp_path / f"command.{end}", tmp_path / f"python.{end}"
        command("convert", project, expected, "--body", "base_link")
        boresight.write(written, mountings, body="base_link")
        assert written.read_text() == expected.read_text()
    boresight.write(tmp_path / "left.json", {"left": mountings["left"]})
    with pytest.raises(boresight.DataError, match="one scanner"):
        boresight.write(tmp_path / "both.json", mountings)
    with pytest.raises(boresight.FormatError, match="urdf"):
        boresight.write(tmp_path / "both.txt", mountings)
    assert not (tmp_path / "both.json").exists() and not (tmp_path / "both.txt").exists()
