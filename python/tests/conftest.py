"""What the tests share: files of the repository, the command, and a small drive."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import boresight

REPOSITORY = Path(__file__).resolve().parents[2]
DATA = REPOSITORY / "tests" / "data"


def command_path() -> str | None:
    """The command: `BORESIGHT`, or that of the path, or that which cargo built last."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    built = [path for profile in ("debug", "release") if (path := target / profile / "boresight").exists()]
    built.sort(key=lambda path: path.stat().st_mtime)
    named = os.environ.get("BORESIGHT") or shutil.which("boresight")
    return named or (str(built[-1]) if built else None)


@pytest.fixture(scope="session")
def command():
    """Runs the command with these arguments."""
    path = command_path()
    if path is None:
        pytest.skip("no command `boresight`: name it with BORESIGHT")

    def run(*arguments):
        done = subprocess.run([path, *map(str, arguments)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def field(tmp_path_factory) -> Path:
    """A cloud of an uneven field, 60,000 points in a LAZ file, at the coordinates of a national grid."""
    rng = np.random.default_rng(7)
    points = rng.uniform([0.0, 0.0, 0.0], [3.0, 3.0, 0.004], (60_000, 3))
    points[:, 2] += 0.05 * np.sin(5.0 * points[:, 0]) * np.cos(4.0 * points[:, 1])
    points += [364_000.0, 5_621_000.0, 60.0]
    path = tmp_path_factory.mktemp("field") / "field.laz"
    intensity = rng.integers(0, 65536, len(points)).astype(np.float32)
    boresight.write(
        path, boresight.Cloud(points, {"time_s": np.linspace(0.0, 60.0, len(points)), "intensity": intensity})
    )
    return path


@pytest.fixture(scope="session")
def drive(tmp_path_factory) -> boresight.Simulation:
    """The smallest simulated drive that there is, with coarse scales and without the joint adjustment."""
    out = tmp_path_factory.mktemp("drive")
    simulated = boresight.simulate(DATA / "tiny_scenario.toml", out / "simulated", progress=None)
    project = simulated.projects[0]
    text, changed = re.subn(
        r"^voxel_sizes_m = .*$", 'method = "two-step"\nvoxel_sizes_m = [0.05, 0.03]', project.read_text(), flags=re.M
    )
    assert changed == 1
    project.write_text(text)
    return simulated
