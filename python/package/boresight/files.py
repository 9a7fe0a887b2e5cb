"""Reading and writing of every format."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from . import _boresight
from ._progress import Progress, listener
from .clouds import Cloud
from .drives import Trajectory
from .logs import DTYPES, Log, kind_of, of_rows, rows_of
from .mounting import Mounting

FilePath: TypeAlias = "str | os.PathLike[str]"

_KINDS = ("cloud", *DTYPES, "mountings")


def detect(path: FilePath) -> tuple[str, list[str]]:
    """The format of a file in words, and the kinds of data that may be in it: ``cloud``, ``trajectory``, ``imu``,
    ``positions``, ``heading``, ``profiles``, ``mountings``."""
    return _boresight.detect(os.fspath(path))


def read(
    path: FilePath,
    kind: str | None = None,
    *,
    crs: str | None = None,
    axes: str = "FRD",
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> Cloud | Log | dict[str, Mounting]:
    """Reads a file of any format that the commands read.

    Parameters
    ----------
    path
        The file.
    kind
        What to read: ``cloud``, ``trajectory``, ``imu``, ``positions``, ``heading``, ``profiles`` or ``mountings``.
        Required if a file holds several kinds; for LAS and LAZ, the cloud is the default.
    crs
        The projected system of the world, such as ``"EPSG:25832"``, for files with latitudes and longitudes.
    axes
        Body axes of the trajectory read from a file with geographic poses: ``"FRD"`` or ``"FLU"``.

    Returns
    -------
    Cloud, numpy.ndarray or dict
        A `Cloud`; the structured array of the kind: `TRAJECTORY`, `IMU`, `POSITIONS`, `HEADING`, `PROFILES`; or, for a
        project or a ``calibration.toml``, the `Mounting` of each scanner by its name. Times of LAS in adjusted GPS time
        are converted to Unix times.
    """
    name = os.fspath(path)
    if kind is None:
        kind = _kind_in(name)
    if kind not in _KINDS:
        raise ValueError(f"kind={kind!r}, expected one of {', '.join(_KINDS)}")
    with listener(progress) as told:
        if kind == "cloud":
            return Cloud(*_boresight.read_cloud(name, told, threads))
        if kind == "mountings":
            scanners = _boresight.read_mountings(name, told)
            return {scanner: Mounting(turn, place) for scanner, turn, place in scanners}
        return of_rows(_boresight.read_log(name, kind, crs, axes, told, threads), kind)


def _kind_in(path: str) -> str:
    format, kinds = detect(path)
    if kinds[:1] == ["cloud"] and ("positions" not in kinds):
        return "cloud"
    if kinds == ["cloud", "positions"]:
        return "positions"
    if len(kinds) != 1:
        held = ", ".join(kinds) or "neither a cloud nor a log"
        raise ValueError(f"{path} is {format} and may hold {held}: choose what to read with kind=")
    return kinds[0]


def write(
    path: FilePath,
    data: Any,
    kind: str | None = None,
    *,
    crs: str | None = None,
    body: str = "body",
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> None:
    """Writes a file in the format given by its extension. The file is written completely or not at all.

    Parameters
    ----------
    path
        Clouds end in ``.las``, ``.laz``, ``.copc.laz``, ``.e57``, ``.ply``, ``.parquet`` or ``.csv``; trajectories in ``.csv``,
        ``.parquet``, ``.tum`` or ``.sbet``; other logs in ``.csv`` or ``.parquet``; mountings in ``.urdf``, ``.launch.py`` and
        ``.yaml`` (ROS 2) or ``.json`` (PDAL, of one scanner).
    data
        A `Cloud` or an (n, 3) array; a `Trajectory`; a structured array, a mapping of names to arrays or a data frame with
        the fields of a log; a mapping of scanners' names to `Mounting`.
    kind
        As in `read`; by default it follows from the fields.
    crs
        The projected system of a trajectory that becomes SBET, such as ``"EPSG:25832"``.
    body
        Name of the body frame in URDF and ROS.
    """
    name = os.fspath(path)
    if isinstance(data, Trajectory):
        data = data.poses
    if kind is None:
        kind = _kind_of(data)
    if kind not in _KINDS:
        raise ValueError(f"kind={kind!r}, expected one of {', '.join(_KINDS)}")
    if not Path(name).name:
        raise ValueError(f"{name!r} is not the name of a file")
    with listener(progress) as told:
        if kind == "cloud":
            cloud = data if isinstance(data, Cloud) else Cloud(data)
            attributes = [
                (key, _stored(values), np.ascontiguousarray(values, dtype=np.float64))
                for key, values in cloud.attributes.items()
            ]
            _boresight.write_cloud(name, cloud.points, attributes, cloud.crs_wkt, told, threads)
        elif kind == "mountings":
            scanners = [
                (scanner, mounting.quaternion_xyzw.tolist(), mounting.translation_m.tolist())
                for scanner, mounting in data.items()
            ]
            _boresight.write_mountings(name, scanners, body, told)
        else:
            _boresight.write_log(name, kind, rows_of(data, kind), crs, told, threads)


def _kind_of(data: Any) -> str:
    if isinstance(data, Mapping) and data and all(isinstance(value, Mounting) for value in data.values()):
        return "mountings"
    return "cloud" if isinstance(data, Cloud) else kind_of(data) or "cloud"


def _stored(values: Any) -> str:
    """The type of an attribute in a file."""
    if values.dtype.kind in "ub" and values.dtype.itemsize <= 4:
        return "u4"
    return "f4" if values.dtype == np.float32 else "f8"
