"""The wheel in a clean environment, and the stubs."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import boresight

SCRIPT = """
import sys
assert not [name for name in ("scipy", "pandas", "tqdm", "matplotlib") if name in sys.modules]
import numpy as np, boresight
assert not [name for name in ("scipy", "pandas", "tqdm", "matplotlib") if name in sys.modules]
points = np.random.default_rng(1).random((1000, 3))
assert boresight.features(points).shape == (1000,)
mounting = boresight.Mounting([0, 0, 0, 1], [1, 2, 3])
assert mounting.rotation.shape == (4,)
poses = {"time_s": [0.0, 1.0], "position_m": np.zeros((2, 3)), "quaternion_xyzw": [[0, 0, 0, 1]] * 2}
assert np.allclose(boresight.georeference(points, np.full(1000, 0.5), poses, mounting), points + [1, 2, 3])
print(boresight.__version__)
"""


def wheel() -> Path:
    path = os.environ.get("BORESIGHT_WHEEL")
    if path is None:
        pytest.skip("BORESIGHT_WHEEL does not name the wheel")
    return Path(path)


def test_the_wheel_is_for_every_python_and_small():
    path = wheel()
    assert re.fullmatch(r"boresight-[\d.]+-cp310-abi3-.*\.whl", path.name), path.name
    assert path.stat().st_size < 12e6, f"{path.stat().st_size / 1e6:.1f} MB"
    names = zipfile.ZipFile(path).namelist()
    assert {"boresight/py.typed", "boresight/_boresight.pyi", "boresight/__init__.py"} <= set(names)
    assert not [name for name in names if "test" in name]


def test_the_wheel_works_in_a_clean_environment(tmp_path):
    path = wheel()
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "-q", "--disable-pip-version-check", path], check=True)
    done = subprocess.run([python, "-c", SCRIPT], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.strip() == boresight.__version__, done.stderr


def test_stubs_agree_with_the_module():
    pytest.importorskip("mypy")
    for arguments in (["mypy.stubtest", "boresight._boresight"], ["mypy", "--strict", "-p", "boresight"]):
        done = subprocess.run(
            [sys.executable, "-m", *arguments], capture_output=True, text=True, cwd=Path(__file__).parents[1]
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_everything_public_is_documented():
    for name in boresight.__all__:
        value = getattr(boresight, name)
        if inspect.isfunction(value) or inspect.isclass(value):
            assert value.__doc__, name
        if inspect.isfunction(value) and "points" in inspect.signature(value).parameters:
            assert "(n, 3)" in value.__doc__ and "metres" in value.__doc__, name
