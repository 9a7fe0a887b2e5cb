"""Campaigns of many small simulated drives, for tests and benches.

Each plot is simulated once; its dates differ by the height to which the soil has settled and by the noise of the poses,
so that every drive is another one and costs a copy. An item takes a second or less.
"""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import dataclass, field
from datetime import date, timedelta
from pathlib import Path

import numpy as np

import boresight

FIRST_DATE = date(2025, 5, 1)
# What the soil settles from date to date, metres.
SETTLED_M = 0.003

_SCENARIO = """\
name = "plot"
seed = {seed}
{no_boards}

[field]
size_m = [{length_m}, 2.0]
margin_m = 2.0

[soil]
cell_m = 0.01

[motion]
rest_s = 2.0
turn_radius_m = 1.0

[imu]
rate_hz = 100.0

[profiles]
rate_hz = {rate_hz}
width = 300

[reference]
soil_spacing_m = 0.008
board_spacing_m = 0.008

{passes}
"""

_STRIP = """\
[[drives]]
passes = [{{ from_m = [0.5, 1.0], to_m = [{end_m}, 1.0] }}]
"""

_BOARDS = """\
[[boards]]
center_m = [0.8, 1.0, 0.3]
tilt_deg = 40.0
azimuth_deg = 30.0
size_m = [0.6, 0.6]

[[boards]]
center_m = [1.8, 1.0, 0.3]
tilt_deg = 40.0
azimuth_deg = 200.0
size_m = [0.6, 0.6]

[[drives]]
passes = [
    { board = 0, heading_deg = 90.0 },
    { board = 1, heading_deg = 90.0 },
    { board = 1, heading_deg = 230.0 },
    { board = 0, heading_deg = 300.0 },
]
"""

_PROJECT = """\
[frame]
body = "FRD"

[trajectory]
file = "poses.csv"
sigma_position_m = 0.002
sigma_rotation_deg = 0.02

[[scanner]]
name = "left"
profiles = "left.bin"
translation_m = {left}
rotation_deg = [-143.769, -0.369, 89.833]
rotation_convention = "bonn"

[[scanner]]
name = "right"
profiles = "right.bin"
translation_m = [1.259, 0.656, 0.585]
rotation_deg = [144.396, -0.346, 91.705]
rotation_convention = "bonn"
"""

_LEFT = "[1.254, -0.545, 0.587]"
_LEFT_BY_TAPE = "[1.24, -0.54, 0.59]"

_CALIBRATED = """
[reference]
file = "tls.laz"

[calibration]
method = "two-step"
voxel_sizes_m = [0.1]
"""


@dataclass
class Campaign:
    """A campaign that was made."""

    path: Path
    plots: list[str] = field(default_factory=list)
    dates: list[str] = field(default_factory=list)

    def drive(self, plot: str, day: str) -> Path:
        """The folder of a drive."""
        return self.path.parent / "drives" / day / plot


def _simulated(folder: Path, seed: int, rate_hz: float, length_m: float | None = None) -> Path:
    """The folder of one simulated drive, with `tls.laz` in the folder around it: a strip of this length, or boards."""
    folder.mkdir(parents=True)
    scenario = folder / "wanted.toml"
    if length_m is None:
        no_boards, passes, field_m = "", _BOARDS, 3.0
    else:
        no_boards, passes, field_m = "boards = []", _STRIP.format(end_m=0.5 + length_m), 1.0 + length_m
    scenario.write_text(
        _SCENARIO.format(seed=seed, no_boards=no_boards, passes=passes, rate_hz=rate_hz, length_m=field_m)
    )
    return boresight.simulate(str(scenario), folder / "made", progress=None).projects[0].parent


def _write_drive(simulated: Path, folder: Path, rng: np.random.Generator, settled_m: float) -> None:
    """A drive with the poses of its truth: lower ground is a robot that drives lower."""
    folder.mkdir(parents=True)
    poses = boresight.read(simulated / "truth" / "trajectory.csv", "trajectory", progress=None)[::2]
    poses["position_m"] += rng.normal(0.0, 3e-4, 3) - [0.0, 0.0, settled_m]
    boresight.write(folder / "poses.csv", poses, "trajectory", progress=None)
    for side in ("left", "right"):
        shutil.copyfile(simulated / f"{side}.bin", folder / f"{side}.bin")


def make(
    folder: Path,
    plots: int,
    dates: int,
    *,
    boards: bool = True,
    rate_hz: float = 40.0,
    many: str | None = None,
    drift: bool = False,
) -> Campaign:
    """Writes a campaign of plots × dates drives, with a calibration for each date if it has `boards`.

    It has dates calibrations, plots × dates drives and plots × (dates - 1) changes: 200 items for 10 × 10. The last
    drive of the plot `many` has twenty times as many profiles. With `drift`, mountings are watched, on strips that are
    long enough.
    """
    length_m = 6.0 if drift else 2.0
    days = [(FIRST_DATE + timedelta(days=7 * k)).isoformat() for k in range(dates)]
    names = [f"P{k + 1:02}" for k in range(plots)]
    made = Campaign(folder / "campaign.toml", names, days)
    scratch = folder.with_name(f"{folder.name}.simulated")
    shutil.rmtree(scratch, ignore_errors=True)
    (folder / "tls").mkdir(parents=True)
    for k, plot in enumerate(names):
        rng = np.random.default_rng(k)
        simulated = _simulated(scratch / plot, k + 1, rate_hz, length_m)
        shutil.copyfile(simulated.parent / "tls.laz", folder / "tls" / f"{plot}.laz")
        for index, day in enumerate(days):
            drive = made.drive(plot, day)
            _write_drive(simulated, drive, rng, index * SETTLED_M)
            (drive / "project.toml").write_text(_PROJECT.format(left=_LEFT))
        if plot == many:
            simulated = _simulated(scratch / "many", k + 1, 20.0 * rate_hz, length_m)
            shutil.rmtree(drive)
            _write_drive(simulated, drive, rng, SETTLED_M)
            (drive / "project.toml").write_text(_PROJECT.format(left=_LEFT))
    if boards:
        simulated = _simulated(scratch / "boards", 99, 40.0)
        rng = np.random.default_rng(99)
        for day in days:
            drive = folder / "boards" / day
            _write_drive(simulated, drive, rng, 0.0)
            shutil.copyfile(simulated.parent / "tls.laz", drive / "tls.laz")
            (drive / "project.toml").write_text(_PROJECT.format(left=_LEFT_BY_TAPE) + _CALIBRATED)
    shutil.rmtree(scratch)
    made.path.write_text(
        "[campaign]\n"
        'drives = "drives/{date}/{plot}/project.toml"\n'
        + ('calibration_project = "boards/{date}/project.toml"\n' if boards else "")
        + 'reference = "tls/{plot}.laz"\n'
        + "tile_m = 1.0\n"
        + ("drift = true\n" if drift else "")
    )
    return made


def make_pheno4d(folder: Path, plots: int, dates: int, rate_hz: float = 40.0) -> Campaign:
    """Writes a campaign of folders as FieldPheno4D has them, with one project as template for all of them."""
    days = [(FIRST_DATE + timedelta(days=7 * k)).strftime("%y%m%d") for k in range(dates)]
    names = [f"Plot{k + 1:02}" for k in range(plots)]
    scratch = folder.with_name(f"{folder.name}.simulated")
    shutil.rmtree(scratch, ignore_errors=True)
    folder.mkdir(parents=True)
    for k, plot in enumerate(names):
        rng = np.random.default_rng(k)
        simulated = _simulated(scratch / plot, k + 1, rate_hz, 2.0)
        truth = boresight.read(simulated / "truth" / "trajectory.csv", "trajectory", progress=None)
        for index, day in enumerate(days):
            drive = folder / plot / day
            for name in ("01_laserprofiles", "02_trajectory"):
                (drive / name).mkdir(parents=True)
            shift = rng.normal(0.0, 3e-4, 3) - [0.0, 0.0, index * SETTLED_M]
            for first, side in enumerate(("left", "right")):
                name = f"{day}_{plot}_{side[0]}"
                shutil.copyfile(simulated / f"{side}.bin", drive / "01_laserprofiles" / f"{name}.bin")
                _write_trj(drive / "02_trajectory" / f"{name}.trj", truth[first::2], shift)
    shutil.rmtree(scratch)
    project = _PROJECT.format(left=_LEFT)
    for line, pattern in (
        ('file = "poses.csv"', 'file = ["02_trajectory/*_l.trj", "02_trajectory/*_r.trj"]'),
        ('profiles = "left.bin"', 'profiles = "01_laserprofiles/*_l.bin"'),
        ('profiles = "right.bin"', 'profiles = "01_laserprofiles/*_r.bin"'),
    ):
        assert line in project
        project = project.replace(line, pattern)
    (folder / "robot.toml").write_text(project)
    path = folder / "campaign.toml"
    path.write_text('[campaign]\ndrives = "{plot}/{date}"\nproject = "robot.toml"\ntile_m = 1.0\n')
    return Campaign(path, names, days)


def _write_trj(path: Path, poses: np.ndarray, shift: np.ndarray) -> None:
    """Time, position, velocity, roll, pitch and yaw, with R = Rz(yaw) Ry(pitch) Rx(roll)."""
    x, y, z, w = poses["quaternion_xyzw"].T
    angles = np.stack(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(2 * (w * y - z * x)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ],
        axis=1,
    )
    columns = [poses["time_s"], poses["position_m"] + shift, np.zeros((len(poses), 3)), angles]
    np.savetxt(path, np.column_stack(columns), fmt="%.9f", header="time x y z vx vy vz roll pitch yaw")


def contents(out: Path) -> dict[str, str]:
    """Hashes of all results of a campaign but for the files that hold times or failures."""
    timed = {"work.json", "log.txt", "hashes.json", "campaign.html", "calibration.html"}
    found = {}
    for path in sorted(out.rglob("*")):
        if path.is_file() and path.name not in timed and path.parent.name != "failed":
            found[str(path.relative_to(out))] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def truncate(path: Path) -> None:
    """Cuts a file short, as a full disk does."""
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 2 + 1)
