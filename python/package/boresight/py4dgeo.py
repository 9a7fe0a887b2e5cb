"""M3C2 with the names of py4dgeo: to port a script, import ``boresight.py4dgeo as py4dgeo``.

The module has `Epoch`, `M3C2`, `as_epoch`, `read_from_xyz` and `read_from_las`. With given normals, distances differ
from py4dgeo's only by rounding, and where a point lies exactly on a radius; see the chapter on Python in the book.
Use py4dgeo itself for registration, segmentation, the analysis of time series and other algorithms.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arrays import Array, numbers_of, points_of
from ._progress import Progress
from .clouds import Cloud, M3C2Result, m3c2
from .files import FilePath, read

__all__ = ["M3C2", "Epoch", "Py4DGeoError", "as_epoch", "read_from_las", "read_from_xyz"]


class Py4DGeoError(ValueError):
    """An error in the use of this module."""


class Epoch:
    """A cloud at one time.

    Parameters
    ----------
    cloud
        (n, 3), metres.
    normals
        (n, 3) unit vectors, kept for the caller.
    additional_dimensions
        (n,) structured array, kept for the caller.
    timestamp
        Kept for the caller.
    """

    def __init__(
        self,
        cloud: Any,
        normals: npt.ArrayLike | None = None,
        additional_dimensions: npt.NDArray[Any] | None = None,
        timestamp: Any = None,
    ) -> None:
        self._cloud = points_of(cloud, "cloud")
        self.normals = None if normals is None else points_of(normals, "normals")
        self.additional_dimensions = additional_dimensions
        self.timestamp = timestamp

    @property
    def cloud(self) -> Array:
        """(n, 3), metres."""
        return self._cloud

    @property
    def points(self) -> Array:
        """The same as `cloud`."""
        return self._cloud

    def build_kdtree(self, leaf_size: int = 10, force_rebuild: bool = False) -> None:
        """Does nothing: each comparison makes its own index."""

    def __len__(self) -> int:
        return len(self._cloud)


def as_epoch(cloud: Any) -> Epoch:
    """An epoch of these points; an `Epoch` is returned as it is."""
    return cloud if isinstance(cloud, Epoch) else Epoch(cloud)


class M3C2:
    """The comparison of two epochs, with the arguments of ``py4dgeo.M3C2``; see `boresight.m3c2`."""

    def __init__(
        self,
        normal_radii: Iterable[float] | None = None,
        orientation_vector: npt.ArrayLike = (0.0, 0.0, 1.0),
        corepoint_normals: npt.ArrayLike | None = None,
        cloud_for_normals: Any = None,
        epochs: Sequence[Any] | None = None,
        corepoints: Any = None,
        cyl_radii: Sequence[float] | None = None,
        cyl_radius: float | None = None,
        max_distance: float = 0.0,
        registration_error: float = 0.0,
        robust_aggr: bool = False,
        *,
        progress: Progress = "tqdm",
        threads: int | None = None,
    ) -> None:
        if epochs is None or len(epochs) != 2:
            raise Py4DGeoError("M3C2 requires exactly two epochs")
        if cyl_radius is None and cyl_radii is not None:
            if len(cyl_radii) != 1:
                raise Py4DGeoError("cyl_radii must be a list containing a single float")
            cyl_radius = cyl_radii[0]
        if cyl_radius is None:
            raise Py4DGeoError("M3C2 requires exactly one cylinder radius to be given as a float")
        if corepoints is None:
            raise Py4DGeoError("M3C2 requires core points")
        if corepoint_normals is None and normal_radii is None:
            raise Py4DGeoError("M3C2 requires normal_radii or corepoint_normals")
        self.epochs = tuple(as_epoch(epoch) for epoch in epochs)
        self.corepoints = points_of(corepoints.cloud if isinstance(corepoints, Epoch) else corepoints, "corepoints")
        self.normal_radii = None if normal_radii is None else [float(radius) for radius in normal_radii]
        self.orientation_vector = numbers_of(orientation_vector, "orientation_vector", 3)
        self.corepoint_normals = (
            None if corepoint_normals is None else points_of(corepoint_normals, "corepoint_normals")
        )
        self.cloud_for_normals = None if cloud_for_normals is None else as_epoch(cloud_for_normals)
        self.cyl_radius, self.max_distance = float(cyl_radius), float(max_distance)
        self.registration_error, self.robust_aggr = float(registration_error), bool(robust_aggr)
        self._progress, self._threads = progress, threads
        self._directions_radii: Array | None = None

    @property
    def name(self) -> str:
        """The name of the algorithm."""
        return "M3C2"

    def _compare(self, first: Epoch, second: Epoch, normals: Array | None) -> M3C2Result:
        return m3c2(
            first,
            second,
            self.corepoints,
            # Without a maximum distance, the cylinder is as long as it is wide.
            max_distance=self.max_distance if self.max_distance > 0.0 else self.cyl_radius,
            cyl_radius=self.cyl_radius,
            normal_radii=self.normal_radii or (),
            orientation_vector=self.orientation_vector,
            corepoint_normals=normals,
            registration_error=self.registration_error,
            robust_aggr=self.robust_aggr,
            progress=self._progress,
            threads=self._threads,
        )

    def _keep_normals(self, found: M3C2Result) -> None:
        self.corepoint_normals, self._directions_radii = found.normals, found.normal_radii

    def directions(self) -> Array:
        """Normals of the core points, (m, 3)."""
        if self.corepoint_normals is None:
            cloud = self.cloud_for_normals or self.epochs[0]
            self._keep_normals(self._compare(cloud, cloud, None))
        assert self.corepoint_normals is not None
        return self.corepoint_normals

    def directions_radii(self) -> Array:
        """The radius used for each normal, (m,), metres."""
        if self._directions_radii is None:
            raise ValueError("radii are only available after the directions were computed")
        return self._directions_radii

    def calculate_distances(self, epoch1: Any, epoch2: Any) -> tuple[Array, npt.NDArray[np.void]]:
        """Distances of these epochs, as `run` returns them."""
        if self.corepoint_normals is None and self.cloud_for_normals is not None:
            self.directions()
        found = self._compare(as_epoch(epoch1), as_epoch(epoch2), self.corepoint_normals)
        if self.corepoint_normals is None:
            self._keep_normals(found)
        return found.distances, found.uncertainties

    def run(self) -> tuple[Array, npt.NDArray[np.void]]:
        """Distances (m,) in metres, and uncertainties (m,) with the fields ``lodetection``, ``spread1``, ``num_samples1``,
        ``spread2``, ``num_samples2``."""
        return self.calculate_distances(*self.epochs)


def _epochs(files: Sequence[FilePath]) -> tuple[Epoch, ...] | Epoch:
    epochs = []
    for file in files:
        cloud = read(file, "cloud")
        assert isinstance(cloud, Cloud)
        epochs.append(Epoch(cloud.points))
    return epochs[0] if len(epochs) == 1 else tuple(epochs)


def read_from_las(*filenames: FilePath) -> tuple[Epoch, ...] | Epoch:
    """Epochs of LAS or LAZ files (or of any other clouds), without attributes."""
    return _epochs(filenames)


def read_from_xyz(*filenames: FilePath) -> tuple[Epoch, ...] | Epoch:
    """Epochs of text files whose first columns are coordinates, without attributes."""
    return _epochs(filenames)
