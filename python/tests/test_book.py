"""The examples of the chapter on Python, one after the other."""

from __future__ import annotations

import re
import shutil

import numpy as np

import boresight
from conftest import REPOSITORY


def test_the_chapter_runs(drive, field, tmp_path, monkeypatch):
    shutil.copytree(drive.projects[0].parents[1], tmp_path, dirs_exist_ok=True)
    (tmp_path / drive.projects[0].parent.name).rename(tmp_path / "recording")
    cloud = boresight.read(field)
    boresight.write(tmp_path / "field-may.laz", cloud)
    boresight.write(tmp_path / "field-june.laz", cloud.points + [0.0, 0.0, 0.004])
    monkeypatch.chdir(tmp_path)
    text = (REPOSITORY / "docs" / "python.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.S | re.M)
    assert len(blocks) >= 5
    space: dict = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), space)
    assert abs(np.nanmedian(space["distances"]) - 0.004) < 1e-4
    assert np.isfinite(space["points"]).any() and len(space["flat"]) > 0
    assert boresight.read("thinned.laz").attributes["label"].dtype == np.uint32
    # Every name that the chapter uses is there.
    for name in set(re.findall(r"boresight\.(\w+)", text)) - {"toml"}:
        assert hasattr(boresight, name) or name in ("dask", "plot", "py4dgeo"), name
