"""Trajectories, calibrations and whole runs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from . import _boresight
from ._arrays import Array, vector_of
from ._progress import Progress, listener
from .logs import DTYPES, Log, of_rows, rows_of
from .mounting import Mounting, rotation_of, table

FilePath: TypeAlias = "str | os.PathLike[str]"


class Trajectory:
    """Poses of the body with standard deviations, estimated by `smooth`.

    Attributes
    ----------
    poses
        (n,) structured array of the type `TRAJECTORY`.
    """

    poses: Log

    def __init__(self, smoothed: _boresight.Smoothed) -> None:
        self._smoothed: _boresight.Smoothed | None = smoothed
        self._result: dict[str, Any] | None = json.loads(smoothed.result())
        self.poses = of_rows(smoothed.poses(), "trajectory")

    def __getstate__(self) -> dict[str, Any]:
        # The covariance needs the factor of the whole drive. Another process gets only the poses.
        return self.__dict__ | {"_smoothed": None}

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def times_s(self) -> Array:
        """(n,) seconds."""
        return np.asarray(self.poses["time_s"])

    @property
    def rotations(self) -> Any:
        """world_from_body as n scipy rotations; (n, 4) quaternions x, y, z, w if scipy is not installed."""
        return rotation_of(self.poses["quaternion_xyzw"])

    def covariance(self, indices: int | Iterable[int]) -> Array:
        """The joint covariance of the poses at these indices, (6 m, 6 m): for each pose, the rotation vector in the
        body frame (rad) and the position in the world (m).

        Raises
        ------
        ValueError
            If the poses came from a file or from another process.
        """
        chosen = [indices] if isinstance(indices, (int, np.integer)) else list(indices)
        wrapped = [int(index) + len(self) if index < 0 else int(index) for index in chosen]
        if any(index < 0 for index in wrapped):
            raise IndexError(f"a pose of {chosen} in a trajectory of {len(self)} poses")
        found = None if self._smoothed is None else self._smoothed.covariance(wrapped)
        if found is None:
            raise ValueError("the poses came from a file or another process: they have no joint covariance")
        return found

    def to_dict(self) -> dict[str, Any]:
        """How the adjustment ended, residuals of each sensor and rejected records, as in `result.json`. Empty for
        poses from a file."""
        return dict(self._result or {})

    def __repr__(self) -> str:
        return f"<Trajectory of {len(self)} poses, {self.times_s[0]:.3f} s to {self.times_s[-1]:.3f} s>"

    def _repr_html_(self) -> str:
        rows = [
            (
                sensor["name"],
                sensor["count"],
                sensor["rejected"],
                f"{sensor['rms_raw']:.4g} {sensor['unit']}",
                f"{sensor['rms_normalised']:.2f}",
            )
            for sensor in self.to_dict().get("sensors", [])
        ]
        head = [("sensor", "records", "rejected", "RMS", "RMS / sigma")]
        return table(head, rows, repr(self)[1:-1])


class Result:
    """The result of a command.

    Attributes
    ----------
    summary
        A few lines of text, with units.
    files
        Files written, the most important first.
    """

    summary: str
    files: list[Path]

    def __init__(self, told: tuple[str, str, list[Path]]) -> None:
        document, self.summary, files = told
        self._document: dict[str, Any] = json.loads(document)
        self.files = [Path(file) for file in files]

    @property
    def headline(self) -> str | None:
        """``usable``, ``care`` or ``unusable``; `None` if the command does not judge its result."""
        return self._document.get("headline")

    @property
    def verdicts(self) -> list[dict[str, Any]]:
        """The verdicts on the result, the most severe first: ``severity``, ``code``, ``text``."""
        return list(self._document.get("verdicts") or [])

    def to_dict(self) -> dict[str, Any]:
        """The whole result, as in `result.json`."""
        return self._document

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.summary}>"

    def _repr_html_(self) -> str:
        rows = [(verdict["severity"], verdict["text"]) for verdict in self.verdicts]
        return table([], rows or [("", self.summary)], f"{type(self).__name__}: {self.headline or ''}".rstrip(": "))


class Calibration(Result):
    """Mountings of the scanners with their uncertainty."""

    def __init__(self, told: tuple[str, str, list[Path]]) -> None:
        super().__init__(told)
        self._found: dict[str, Any] = self._document.get("calibration") or {}

    @property
    def mountings(self) -> dict[str, Mounting]:
        """The mounting of each scanner by name, with standard deviations."""
        return {name: _mounting(scanner) for name, scanner in self._document["scanners"].items()}

    @property
    def parameters(self) -> list[str]:
        """Names of the rows of the covariance, such as ``left.tx``."""
        return [parameter["name"] for parameter in self._found.get("parameters", [])]

    @property
    def units(self) -> list[str]:
        """Units of the parameters."""
        return [parameter["unit"] for parameter in self._found.get("parameters", [])]

    @property
    def covariance(self) -> Array | None:
        """(p, p) covariance of the parameters in their units, NaN for those that are fixed or that the data do not
        determine; `None` if the method has none."""
        return _matrix(self._found.get("covariance"))

    @property
    def correlation(self) -> Array | None:
        """(p, p) correlations of the parameters."""
        return _matrix(self._found.get("correlation"))

    @property
    def undetermined(self) -> list[str]:
        """Directions that the data do not determine, in words. Affected parameters have standard deviations of NaN."""
        return [what["what"] for what in self._found.get("undetermined") or []]

    def _repr_html_(self) -> str:
        def with_sigma(values: Array, sigmas: Array | None, scale: float, form: str) -> list[str]:
            if sigmas is None:
                return [f"{scale * value:{form}}" for value in values]
            known = ["not determined" if np.isnan(sigma) else f"± {scale * sigma:{form}}" for sigma in sigmas]
            return [f"{scale * value:{form}} {sigma}" for value, sigma in zip(values, known)]

        rows = []
        for name, scanner in self._document["scanners"].items():
            mounting = _mounting(scanner)
            angles = scanner["body_from_scanner"]["euler_deg"]["zyx"]
            place = with_sigma(mounting.translation_m, mounting.sigma_translation_m, 1e3, ".2f")
            turn = with_sigma(np.array(angles), _euler_sigma(scanner), 1.0, ".4f")
            rows.append((name, *place, *turn))
        head = [("scanner", "x mm", "y mm", "z mm", "roll °", "pitch °", "yaw °")]
        return table(head, rows, f"{type(self).__name__}: {self.headline or ''}".rstrip(": "))


class Run(Result):
    """A whole run: trajectory, mountings, clouds, comparison, report."""

    @property
    def calibration(self) -> Calibration:
        """The mountings with their uncertainty."""
        return Calibration((json.dumps(self._document), self.summary, list(self.files)))

    @property
    def report(self) -> Path:
        """The report, a page."""
        return self.files[0].with_name("report.html")

    @property
    def clouds(self) -> list[Path]:
        """The georeferenced clouds."""
        return [file for file in self.files if file.name.endswith((".laz", ".las"))]

    def _repr_html_(self) -> str:
        return self.calibration._repr_html_() + super()._repr_html_()


class Georeferenced(Result):
    """Clouds of a project."""

    @property
    def clouds(self) -> list[Path]:
        """One file per scanner."""
        return list(self.files)


class Simulation(Result):
    """Simulated drives."""

    @property
    def projects(self) -> list[Path]:
        """The project of each drive."""
        return [Path(drive["project"]) for drive in self._document["drives"]]

    @property
    def reference(self) -> Path:
        """The terrestrial scan."""
        return Path(self._document["reference"]["file"])


def _matrix(rows: list[list[float | None]] | None) -> Array | None:
    return None if rows is None else np.array(rows, dtype=np.float64)


def _euler_sigma(scanner: dict[str, Any]) -> Array | None:
    sigma = (scanner.get("sigma") or {}).get("euler_deg")
    return None if sigma is None else np.array(sigma["zyx"], dtype=np.float64)


def _mounting(scanner: dict[str, Any]) -> Mounting:
    pose, sigma = scanner["body_from_scanner"], scanner.get("sigma") or {}
    known = {key: np.array(sigma[key], dtype=np.float64) for key in ("translation_m", "rotation_deg") if sigma.get(key)}
    return Mounting(
        pose["quaternion_xyzw"],
        pose["translation_m"],
        sigma_translation_m=known.get("translation_m"),
        sigma_rotation_deg=known.get("rotation_deg"),
    )


def smooth(
    project: FilePath | None = None,
    *,
    imu: Any = None,
    positions: Any = None,
    heading: Any = None,
    lever_arm_m: npt.ArrayLike | None = None,
    sigma_position_m: npt.ArrayLike | None = None,
    sigma_heading_deg: float = 0.7,
    heading_offset_deg: float = 0.0,
    axes: str = "FRD",
    gravity_m_s2: float = 9.81,
    gyro_noise_deg_sqrt_h: float = 0.15,
    accel_noise_ug_sqrt_hz: float = 57.0,
    gyro_bias_instability_deg_h: float = 7.0,
    accel_bias_instability_ug: float = 14.0,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> Trajectory:
    """The trajectory of a drive: poses at every sample of the IMU, with standard deviations.

    The input is either a project, as for the command `boresight trajectory`, or logs in memory.

    Parameters
    ----------
    project
        A project file, or a folder with a `project.toml`.
    imu, positions, heading
        Logs: structured arrays of the types `IMU`, `POSITIONS` and `HEADING`, or anything with their fields. Headings may be
        left out.
    lever_arm_m
        The prism or antenna in the body frame, (3,), metres.
    sigma_position_m
        Standard deviation of positions without a covariance: one number, or east, north, up, metres.
    sigma_heading_deg
        Standard deviation of headings that have none of their own, degrees.
    heading_offset_deg
        Heading of the body = heading of the antennas + this, degrees, clockwise.
    axes
        Body axes: ``"FRD"`` (x forward, y right, z down) or ``"FLU"`` (x forward, y left, z up).
    gravity_m_s2
        Gravity at the site, m/s².
    gyro_noise_deg_sqrt_h, accel_noise_ug_sqrt_hz, gyro_bias_instability_deg_h, accel_bias_instability_ug
        The IMU's datasheet: °/√h, µg/√Hz, °/h, µg.
    """
    logs = (imu, positions, heading)
    if project is not None:
        if any(log is not None for log in logs):
            raise ValueError("a project has its own logs: give either a project or logs")
        with listener(progress) as told:
            return Trajectory(_boresight.smooth_project(os.fspath(project), told, threads))
    for name, value in (
        ("imu", imu),
        ("positions", positions),
        ("lever_arm_m", lever_arm_m),
        ("sigma_position_m", sigma_position_m),
    ):
        if value is None:
            raise ValueError(f"without a project, {name} is needed")
    settings = {
        "axes": axes,
        "gravity_m_s2": float(gravity_m_s2),
        "lever_arm_m": vector_of(lever_arm_m, "lever_arm_m"),
        "sigma_position_m": vector_of(
            np.full(3, sigma_position_m) if np.ndim(sigma_position_m) == 0 else sigma_position_m,  # type: ignore[arg-type]
            "sigma_position_m",
        ),
        "sigma_heading_rad": float(np.deg2rad(sigma_heading_deg)),
        "heading_offset_rad": float(np.deg2rad(heading_offset_deg)),
        "gyro_noise_deg_sqrt_h": float(gyro_noise_deg_sqrt_h),
        "accel_noise_ug_sqrt_hz": float(accel_noise_ug_sqrt_hz),
        "gyro_bias_instability_deg_h": float(gyro_bias_instability_deg_h),
        "accel_bias_instability_ug": float(accel_bias_instability_ug),
    }
    rows = [
        rows_of(log if log is not None else np.empty(0, DTYPES[kind]), kind)
        for log, kind in zip(logs, ("imu", "positions", "heading"))
    ]
    with listener(progress) as told:
        return Trajectory(_boresight.smooth_logs(rows[0], rows[1], rows[2], settings, told, threads))


def calibrate(
    project: FilePath,
    out: FilePath | None = None,
    *,
    method: str | None = None,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> Calibration:
    """Estimates the mountings of all scanners of a project like `run`, without writing clouds, as the command
    `boresight calibrate`.

    Parameters
    ----------
    project
        A project file, or a folder with a `project.toml`.
    out
        Folder for `calibration.toml`; by default `out` next to the project.
    method
        ``"joint"`` (one adjustment of trajectory and mountings), ``"two-step"`` (the mountings after the trajectory) or
        ``"paper"``; by default that of the project, which is joint unless it says otherwise.
    """
    return Calibration(_command("calibrate", project, out, method=method, progress=progress, threads=threads))


def run(
    project: FilePath,
    out: FilePath | None = None,
    *,
    fresh: bool = False,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> Run:
    """Runs all stages of a project like the command `boresight run`: trajectory, calibration, clouds, comparison,
    report.

    Parameters
    ----------
    project
        A project file, or a folder with a `project.toml`.
    out
        Folder for the results; by default `out` next to the project.
    fresh
        Run all stages again, also those that an earlier run with this folder finished from the same inputs.
    """
    return Run(_command("run", project, out, fresh=fresh, progress=progress, threads=threads))


def georeference_project(
    project: FilePath,
    out: FilePath | None = None,
    *,
    calibration: FilePath | None = None,
    trajectory: FilePath | None = None,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> Georeferenced:
    """Writes the clouds of a project, like the command `boresight georeference`.

    Parameters
    ----------
    project
        A project file, or a folder with a `project.toml`.
    out
        Folder for the clouds; by default `out` next to the project.
    calibration
        Mountings instead of the project's: a `calibration.toml`.
    trajectory
        Poses instead of estimating them: a trajectory file.
    """
    paths = [None if path is None else os.fspath(path) for path in (calibration, trajectory)]
    return Georeferenced(
        _command(
            "georeference", project, out, calibration=paths[0], trajectory=paths[1], progress=progress, threads=threads
        )
    )


def _command(
    name: str,
    project: FilePath,
    out: FilePath | None,
    *,
    fresh: bool = False,
    method: str | None = None,
    calibration: str | None = None,
    trajectory: str | None = None,
    progress: Progress,
    threads: int | None,
) -> tuple[str, str, list[Path]]:
    folder = None if out is None else os.fspath(out)
    with listener(progress) as told:
        return _boresight.command(
            name, os.fspath(project), folder, fresh, method, calibration, trajectory, told, threads
        )


def simulate(
    scenario: str | os.PathLike[str] = "demo",
    out: FilePath = "simulated",
    *,
    seed: int | None = None,
    force: bool = False,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> Simulation:
    """Writes simulated drives as sensor files, together with the truth, like the command `boresight simulate`.

    Parameters
    ----------
    scenario
        ``"demo"``, ``"full"``, ``"plain"``, or a scenario file.
    out
        Folder for the drives.
    seed
        Seed of all random numbers; that of the scenario by default.
    force
        Replace existing drives in the folder.
    """
    with listener(progress) as told:
        return Simulation(_boresight.simulate(os.fspath(scenario), os.fspath(out), seed, force, told, threads))
