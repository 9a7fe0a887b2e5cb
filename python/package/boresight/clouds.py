"""Clouds, and functions of their points."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _boresight
from ._arrays import Array, numbers_of, points_of, positive, vector_of
from ._progress import Progress, listener
from .errors import BoresightWarning
from .logs import rows_of
from .mounting import Mounting, quaternion_of, table

_COLUMNS: dict[str, list[str]] = dict(_boresight.feature_columns())

FEATURES: tuple[str, ...] = tuple(_COLUMNS)
"""Names of all features, as in the command `boresight features`."""

DEFAULT_FEATURES: tuple[str, ...] = tuple(_boresight.default_features())
"""The features that are computed by default."""


class Cloud:
    """Points with attributes.

    Attributes
    ----------
    points
        (n, 3) float64: east, north, up, metres.
    attributes
        Arrays of n values by name: ``time_s`` (seconds), ``intensity`` (as recorded), and others of the file.
    crs_wkt
        The coordinate reference system as WKT, if the file names one.
    """

    points: Array
    attributes: dict[str, npt.NDArray[Any]]
    crs_wkt: str | None

    def __init__(
        self,
        points: npt.ArrayLike,
        attributes: Mapping[str, npt.ArrayLike] | None = None,
        crs_wkt: str | None = None,
    ) -> None:
        self.points = points_of(points)
        self.attributes = {name: np.asarray(values) for name, values in (attributes or {}).items()}
        self.crs_wkt = crs_wkt
        for name, values in self.attributes.items():
            if values.shape != (len(self.points),):
                raise ValueError(f"{name!r} has the shape {values.shape}, expected ({len(self.points)},)")

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, chosen: Any) -> Cloud:
        """The points selected by an index array, a mask or a slice, with their attributes."""
        chosen = np.atleast_1d(chosen) if not isinstance(chosen, slice) else chosen
        attributes = {name: values[chosen] for name, values in self.attributes.items()}
        return Cloud(self.points[chosen], attributes, self.crs_wkt)

    def to_dict(self) -> dict[str, Any]:
        """The number of points, their extent and the names of the attributes."""
        low, high = (self.points.min(axis=0), self.points.max(axis=0)) if len(self) else (np.zeros(3), np.zeros(3))
        return {
            "points": len(self),
            "low_m": low.tolist(),
            "high_m": high.tolist(),
            "attributes": {name: str(values.dtype) for name, values in self.attributes.items()},
            "crs_wkt": self.crs_wkt,
        }

    def __repr__(self) -> str:
        return f"<Cloud of {len(self)} points with {', '.join(self.attributes) or 'no attributes'}>"

    def _repr_html_(self) -> str:
        about = self.to_dict()
        rows: list[tuple[Any, ...]] = [
            (axis, f"{low:.3f} m", f"{high:.3f} m")
            for axis, low, high in zip(("east", "north", "up"), about["low_m"], about["high_m"])
        ]
        for name, values in self.attributes.items():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                rows.append((name, f"{np.nanmin(values):g}", f"{np.nanmax(values):g}") if len(self) else (name, "", ""))
        return table([("", "lowest", "highest")], rows, f"Cloud of {len(self)} points")


def features(
    points: Any,
    *,
    neighbours: int | None = None,
    radius_m: float | None = None,
    features: Iterable[str] | str | None = None,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> npt.NDArray[np.void]:
    """Shape of every point's neighbourhood: the same numbers as the command `boresight features`, to the last bit.

    Parameters
    ----------
    points
        (n, 3) float64, metres, or a `Cloud`. A contiguous float64 array is not copied.
    neighbours
        Number of nearest points in a neighbourhood, including the point itself; 50 by default.
    radius_m
        Use all points within this radius instead, metres.
    features
        Names from `FEATURES`, or ``"all"``; `DEFAULT_FEATURES` by default.

    Returns
    -------
    numpy.ndarray
        (n,) structured: one float32 field for each column of the features (``neighbours`` is uint32, ``normal`` has
        ``normal_x``, ``normal_y``, ``normal_z``); omnivariance and eigenvalue_sum in m², radius_m in metres, the others
        without unit. NaN where a feature is undefined.
    """
    array = points_of(points)
    if neighbours is not None and radius_m is not None:
        raise ValueError("neighbours and radius_m exclude each other")
    if neighbours is not None and not (isinstance(neighbours, (int, np.integer)) and neighbours >= 1):
        raise ValueError(f"neighbours is {neighbours!r}, expected a whole number above zero")
    if radius_m is not None:
        radius_m = positive(radius_m, "radius_m")
    names = list(dict.fromkeys(_named(features)))
    k = int(neighbours) if neighbours is not None else 50
    if radius_m is None and k > len(array):
        warnings.warn(
            f"the cloud has {len(array)} points: every neighbourhood is the whole cloud instead of the {k} nearest points",
            BoresightWarning,
            stacklevel=2,
        )
    with listener(progress) as told:
        words = _boresight.features(array, names, k, radius_m, told, threads)
    columns = [(column, "u4" if name == "neighbours" else "f4") for name in names for column in _COLUMNS[name]]
    dtype = np.dtype(
        {
            "names": [column for column, _ in columns],
            "formats": [kind for _, kind in columns],
            "offsets": [4 * at for at in range(len(columns))],
            "itemsize": 4 * words.shape[1],
        }
    )
    return words.reshape(-1).view(dtype)


def _named(features: Iterable[str] | str | None) -> list[str]:
    if features is None:
        return list(DEFAULT_FEATURES)
    asked = features.split(",") if isinstance(features, str) else list(features)
    names: list[str] = []
    for name in asked:
        if name == "all":
            names.extend(FEATURES)
        elif name in FEATURES:
            names.append(name)
        else:
            raise ValueError(f"there is no feature {name!r}; there are {', '.join(FEATURES)}, all")
    if not names:
        raise ValueError("features is empty, expected at least one name")
    return names


def thin(
    points: Any,
    voxel_m: float,
    *,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> npt.NDArray[np.uint32]:
    """One point per voxel, the nearest to its centre: the same points that the command `boresight thin` keeps.

    Parameters
    ----------
    points
        (n, 3) float64, metres, finite, or a `Cloud`.
    voxel_m
        Edge of the voxels, metres.

    Returns
    -------
    numpy.ndarray
        (m,) uint32: indices of the points kept, ascending. ``cloud[thin(cloud, 0.01)]`` is the thinned cloud.
    """
    array, edge_m = points_of(points), positive(voxel_m, "voxel_m")
    with listener(progress) as told:
        return _boresight.thin(array, edge_m, told, threads)


class M3C2Result:
    """Distances at core points, signed along their normals.

    Attributes
    ----------
    corepoints, normals
        (m, 3), metres and unit vectors.
    distances
        (m,), metres: the second epoch minus the first; NaN where a cylinder is empty.
    uncertainties
        (m,) structured, as in py4dgeo: ``lodetection`` (level of detection at 95 %, metres), ``spread1``, ``spread2``
        (metres) and ``num_samples1``, ``num_samples2``.
    normal_radii
        (m,), metres: the radius used for each normal; NaN for given normals.
    """

    corepoints: Array
    normals: Array
    distances: Array
    uncertainties: npt.NDArray[np.void]
    normal_radii: Array
    _statistics: dict[str, Any]

    def __init__(self, found: Mapping[str, Any]) -> None:
        self.corepoints, self.normals = found["corepoints"], found["normals"]
        self.distances, self.normal_radii = found["distances"], found["normal_radii"]
        kinds = [
            ("lodetection", "f8"),
            ("spread1", "f8"),
            ("num_samples1", "i8"),
            ("spread2", "f8"),
            ("num_samples2", "i8"),
        ]
        self.uncertainties = np.empty(len(self.distances), dtype=kinds)
        for name, _ in kinds:
            self.uncertainties[name] = found[name]
        text = found["statistics"]
        self._statistics = {"core_points": len(self.distances), "n": 0} if text is None else json.loads(text)

    def to_dict(self) -> dict[str, Any]:
        """Statistics of the distances, as in the command `boresight compare`: numbers of core points and of distances;
        mean, standard deviation, root mean square, median and NMAD, metres; and, of the distances with a level of
        detection, the share that exceeds it. A value that is not determined is `None`."""
        return dict(self._statistics)

    def __repr__(self) -> str:
        return f"<M3C2Result: {self.to_dict()}>"

    def _repr_html_(self) -> str:
        return table([], list(self.to_dict().items()), "M3C2")


def m3c2(
    epoch1: Any,
    epoch2: Any,
    corepoints: Any = None,
    *,
    cyl_radius: float | None = None,
    normal_radii: Iterable[float] | None = None,
    max_distance: float | None = None,
    registration_error: float = 0.0,
    robust_aggr: bool = False,
    orientation_vector: npt.ArrayLike = (0.0, 0.0, 1.0),
    corepoint_normals: Any = None,
    direction: npt.ArrayLike | None = None,
    student: bool = False,
    one_sided: bool = False,
    min_points: int = 1,
    corepoint_spacing_m: float | None = None,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> M3C2Result:
    """Distances of ``epoch2`` to ``epoch1`` along local normals (M3C2), like the command `boresight compare` with
    ``epoch1`` as reference. Arguments are named as in py4dgeo. Lengths that are not given follow from the points, as for
    the command.

    Parameters
    ----------
    epoch1, epoch2
        (n, 3) float64, metres, or `Cloud`.
    corepoints
        (m, 3), metres; by default ``epoch1`` thinned to ``corepoint_spacing_m``.
    cyl_radius, max_distance
        Radius of the cylinder and half its length, metres.
    normal_radii
        Radii of the neighbourhoods of ``epoch1`` for normals, metres; the most planar neighbourhood is used.
    registration_error
        Added to the level of detection, metres.
    robust_aggr
        Use median and inter-quartile range instead of mean and standard deviation.
    orientation_vector
        Computed normals point to this side, (3,).
    corepoint_normals
        (m, 3) or (1, 3): given normals, which are then not computed.
    direction
        (3,): one direction instead of normals.
    student
        Compute the level of detection from Student's t, which is valid for few points too.
    one_sided
        Cylinders extend only in the direction of the normal.
    min_points
        Smallest number of points of either epoch in a cylinder.
    """
    first, second = points_of(epoch1, "epoch1"), points_of(epoch2, "epoch2")
    core = None if corepoints is None else points_of(corepoints, "corepoints")
    normals = None if corepoint_normals is None else points_of(corepoint_normals, "corepoint_normals")
    if normals is not None and direction is not None:
        raise ValueError("corepoint_normals and direction exclude each other")
    if normals is not None and core is None:
        raise ValueError("corepoint_normals are given without corepoints")
    if normals is not None and core is not None and len(normals) == 1 and len(core) != 1:
        direction, normals = normals[0], None
    settings = {
        "corepoint_spacing_m": (
            None if corepoint_spacing_m is None else positive(corepoint_spacing_m, "corepoint_spacing_m")
        ),
        "normal_radii": None if normal_radii is None else [float(radius) for radius in normal_radii],
        "cyl_radius": None if cyl_radius is None else positive(cyl_radius, "cyl_radius"),
        "max_distance": None if max_distance is None else float(max_distance),
        "registration_error": float(registration_error),
        "robust_aggr": bool(robust_aggr),
        "student": bool(student),
        "one_sided": bool(one_sided),
        "min_points": int(min_points),
        "direction": None if direction is None else vector_of(direction, "direction"),
        "orientation_vector": vector_of(orientation_vector, "orientation_vector"),
    }
    with listener(progress) as told:
        return M3C2Result(_boresight.m3c2(first, second, core, normals, settings, told, threads))


def georeference(
    points: Any,
    times: npt.ArrayLike,
    trajectory: Any,
    mounting: Mounting | tuple[Any, npt.ArrayLike],
    *,
    time_offset_s: float = 0.0,
    progress: Progress = "tqdm",
    threads: int | None = None,
) -> Array:
    """Points of a scanner in the world: x_m = t_mb + R_mb (t_bs + R_bs x_s).

    Parameters
    ----------
    points
        (n, 3) in the frame of the scanner, metres.
    times
        (n,) seconds, in the order of the measurements.
    trajectory
        Poses: a `Trajectory`, a structured array of the type `TRAJECTORY`, or anything with its fields ``time_s``,
        ``position_m`` (n, 3) and ``quaternion_xyzw`` (n, 4). Positions between poses follow a cubic curve if velocities
        are known, and a straight line otherwise.
    mounting
        A `Mounting`, or rotation and translation (metres) of body_from_scanner.
    time_offset_s
        Time of the trajectory = time of the scanner + this, seconds.

    Returns
    -------
    numpy.ndarray
        (n, 3) float64: east, north, up, metres; NaN before the first and after the last pose.
    """
    array = points_of(points)
    times_s = numbers_of(times, "times", len(array))
    poses = rows_of(getattr(trajectory, "poses", trajectory), "trajectory")
    if isinstance(mounting, Mounting):
        rotation, place = mounting.quaternion_xyzw, mounting.translation_m
    else:
        try:
            rotation, place = mounting  # type: ignore[assignment]
        except (TypeError, ValueError):
            raise ValueError("mounting is neither a Mounting nor (rotation, translation_m)") from None
    placed = (quaternion_of(rotation), vector_of(place, "translation_m"))
    with listener(progress) as told:
        return _boresight.georeference(array, times_s, poses, placed, float(time_offset_s), told, threads)
