"""Plots with matplotlib: ``pip install boresight[plot]``. Each draws into given or new axes and returns the axes."""

from __future__ import annotations

from typing import Any

import numpy as np

from .clouds import M3C2Result
from .drives import Calibration, Trajectory


def _axes(axes: Any) -> Any:
    if axes is not None:
        return axes
    from matplotlib import pyplot

    return pyplot.subplots()[1]


def distances(result: M3C2Result, axes: Any = None, *, limit_m: float | None = None) -> Any:
    """A map of M3C2 distances, mm; the colour scale ends at ``limit_m`` (metres), by default the 98 % quantile."""
    axes = _axes(axes)
    known = np.isfinite(result.distances)
    points, millimetres = result.corepoints[known], 1e3 * result.distances[known]
    limit = (
        1e3 * limit_m
        if limit_m is not None
        else float(np.quantile(np.abs(millimetres), 0.98))
        if len(millimetres)
        else 1.0
    )
    drawn = axes.scatter(points[:, 0], points[:, 1], c=millimetres, s=1, cmap="RdBu_r", vmin=-limit, vmax=limit)
    axes.figure.colorbar(drawn, ax=axes, label="distance / mm")
    axes.set(xlabel="east / m", ylabel="north / m", aspect="equal")
    return axes


def track(trajectory: Trajectory, axes: Any = None) -> Any:
    """The track of the body from above, coloured by the standard deviation of its position, mm."""
    axes = _axes(axes)
    poses = trajectory.poses
    sigma_mm = 1e3 * np.linalg.norm(poses["sigma_position_m"], axis=1)
    known = np.isfinite(sigma_mm).any()
    drawn = axes.scatter(poses["position_m"][:, 0], poses["position_m"][:, 1], c=sigma_mm if known else None, s=1)
    if known:
        axes.figure.colorbar(drawn, ax=axes, label="standard deviation of the position / mm")
    axes.set(xlabel="east / m", ylabel="north / m", aspect="equal")
    return axes


def correlation(calibration: Calibration, axes: Any = None) -> Any:
    """Correlations of the parameters of a calibration."""
    axes = _axes(axes)
    matrix = calibration.correlation
    if matrix is None:
        raise ValueError("the calibration has no correlations")
    drawn = axes.imshow(matrix, cmap="RdBu_r", vmin=-1, vmax=1)
    axes.figure.colorbar(drawn, ax=axes, label="correlation")
    axes.set_xticks(range(len(calibration.parameters)), calibration.parameters, rotation=90)
    axes.set_yticks(range(len(calibration.parameters)), calibration.parameters)
    return axes
