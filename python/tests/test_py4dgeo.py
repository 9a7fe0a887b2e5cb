"""A script for py4dgeo gives the same distances with one line changed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import boresight
from conftest import DATA

PATH = Path(__file__).with_name("py4dgeo_script.py")
SCRIPT = PATH.read_text()


def run(script: str) -> dict:
    space: dict = {"__file__": str(PATH)}
    exec(compile(script, PATH.name, "exec"), space)
    return space


def moved() -> str:
    script, changed = re.subn(r"^import py4dgeo$", "import boresight.py4dgeo as py4dgeo", SCRIPT, flags=re.M)
    assert changed == 1
    return script


def test_a_script_moves_by_its_import(tmp_path, monkeypatch):
    # It writes a log into the current folder when it is imported.
    monkeypatch.chdir(tmp_path)
    py4dgeo = pytest.importorskip("py4dgeo")
    # With several radii its k-d tree, which it takes by default, counts inner points twice in the normals.
    py4dgeo.Epoch.set_default_radius_search_tree("octree")
    theirs, ours = run(SCRIPT), run(moved())
    assert type(ours["m3c2"]).__module__ == "boresight.py4dgeo" and type(theirs["m3c2"]).__module__ == "py4dgeo.m3c2"
    known = np.isfinite(theirs["distances"])
    assert known.sum() > 500 and np.array_equal(known, np.isfinite(ours["distances"]))
    assert np.abs(theirs["distances"] - ours["distances"])[known].max() < 1e-15
    assert ours["uncertainties"].dtype == theirs["uncertainties"].dtype
    for name in ("lodetection", "spread1", "spread2", "num_samples1", "num_samples2"):
        assert np.abs(theirs["uncertainties"][name] - ours["uncertainties"][name])[known].max() < 1e-15, name


def test_distances_are_those_stored_of_py4dgeo():
    case = {path.stem: np.load(path) for path in (DATA / "m3c2_case").glob("*.npy")}
    from boresight import py4dgeo

    script = run(moved())
    algorithm = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(case["epoch1"]), py4dgeo.Epoch(case["epoch2"])),
        corepoints=case["corepoints"],
        corepoint_normals=case["normals"],
        cyl_radius=script["m3c2"].cyl_radius,
        max_distance=script["m3c2"].max_distance,
        registration_error=script["m3c2"].registration_error,
    )
    distances, uncertainties = algorithm.run()
    known = np.isfinite(case["distance"])
    assert np.array_equal(known, np.isfinite(distances)) and known.sum() > 500
    assert np.abs(distances - case["distance"])[known].max() < 1e-12
    assert np.array_equal(uncertainties["num_samples1"], case["num_samples1"])
    assert np.array_equal(uncertainties["num_samples2"], case["num_samples2"])


def test_wrong_use_is_refused():
    from boresight import py4dgeo

    epoch = py4dgeo.Epoch(np.random.default_rng(1).random((100, 3)))
    for arguments in (
        {"epochs": (epoch,), "cyl_radius": 0.1, "normal_radii": [0.2], "corepoints": epoch.cloud},
        {"epochs": (epoch, epoch), "normal_radii": [0.2], "corepoints": epoch.cloud},
        {"epochs": (epoch, epoch), "cyl_radius": 0.1, "corepoints": epoch.cloud},
    ):
        with pytest.raises(py4dgeo.Py4DGeoError):
            py4dgeo.M3C2(**arguments)
    assert issubclass(py4dgeo.Py4DGeoError, ValueError) and boresight.__version__
