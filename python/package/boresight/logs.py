"""Logs as structured arrays. Values that a record does not have are NaN."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arrays import Array

TRAJECTORY = np.dtype(
    [
        ("time_s", "f8"),
        ("position_m", "f8", (3,)),
        ("quaternion_xyzw", "f8", (4,)),
        ("velocity_m_s", "f8", (3,)),
        ("gyro_bias_rad_s", "f8", (3,)),
        ("accel_bias_m_s2", "f8", (3,)),
        ("sigma_position_m", "f8", (3,)),
        ("sigma_rotation_rad", "f8", (3,)),
    ]
)
"""Poses world_from_body: east, north, up, and the rotation from the body to the world; velocity in the world; biases
of the IMU in the body; standard deviations along and about east, north, up."""

IMU = np.dtype([("time_s", "f8"), ("gyro_rad_s", "f8", (3,)), ("accel_m_s2", "f8", (3,))])
"""Samples of an IMU in body axes; each is the mean until the next one. At rest, the specific force points upwards."""

POSITIONS = np.dtype([("time_s", "f8"), ("position_m", "f8", (3,)), ("covariance_m2", "f8", (3, 3))])
"""Positions of a prism or an antenna: east, north, up, and their covariance."""

HEADING = np.dtype(
    [
        ("time_s", "f8"),
        ("heading_rad", "f8"),
        ("sigma_rad", "f8"),
        ("pitch_rad", "f8"),
        ("pitch_sigma_rad", "f8"),
    ]
)
"""Headings of an antenna baseline, clockwise from north, and its pitch above the horizon."""

PROFILES = np.dtype([("time_s", "f8"), ("position_m", "f8", (3,)), ("intensity", "f8")])
"""Points in the frame of their scanner; a profile scanner has y = 0."""

DTYPES: dict[str, np.dtype[np.void]] = {
    "trajectory": TRAJECTORY,
    "imu": IMU,
    "positions": POSITIONS,
    "heading": HEADING,
    "profiles": PROFILES,
}

_NEEDED = {
    "trajectory": ("time_s", "position_m", "quaternion_xyzw"),
    "imu": ("time_s", "gyro_rad_s", "accel_m_s2"),
    "positions": ("time_s", "position_m"),
    "heading": ("time_s", "heading_rad"),
    "profiles": ("time_s", "position_m"),
}

_AXES = {"quaternion_xyzw": "xyzw"}

Log = npt.NDArray[np.void]


def of_rows(rows: Array, kind: str) -> Log:
    """Rows from the compiled part as a structured array, without a copy."""
    return rows.reshape(-1).view(DTYPES[kind])


def names_of(data: Any) -> tuple[str, ...]:
    """Names of fields of a structured array, a mapping or a data frame, without the axes of split columns."""
    if isinstance(data, np.ndarray):
        return data.dtype.names or ()
    if isinstance(data, Mapping):
        return tuple(str(name) for name in data)
    return tuple(str(name) for name in getattr(data, "columns", ()))


def _columns(name: str, dtype: np.dtype[Any]) -> list[str]:
    """Names of the columns of a field in a data frame."""
    if dtype.shape == ():
        return [name]
    axes = _AXES.get(name, "xyz")
    if len(dtype.shape) == 2:
        return [f"{name}_{a}{b}" for a in axes for b in axes]
    return [f"{name}_{axis}" for axis in axes]


def kind_of(data: Any) -> str | None:
    """The kind of log that has these fields; `None` for other data."""
    names = set(names_of(data))
    for kind in ("trajectory", "imu", "heading", "positions"):
        wanted = ([name] + _columns(name, DTYPES[kind][name])[:1] for name in _NEEDED[kind])
        if all(names.intersection(of) for of in wanted):
            is_profiles = kind == "positions" and "intensity" in names
            return "profiles" if is_profiles else kind
    return None


def rows_of(data: Any, kind: str, name: str | None = None) -> Array:
    """The rows of a structured array (without a copy if its type is that of the kind), a mapping of names to arrays, or
    a data frame of `to_pandas`."""
    dtype = DTYPES[kind]
    name = name or kind
    if isinstance(data, np.ndarray) and data.dtype == dtype and data.ndim == 1:
        return np.ascontiguousarray(data).view("f8").reshape(len(data), dtype.itemsize // 8)
    names = names_of(data)
    if not names:
        raise ValueError(f"{name} has no named fields, expected {', '.join(_NEEDED[kind])}")
    filled: Log | None = None
    for field in dtype.names or ():
        columns = _columns(field, dtype[field])
        if field in names:
            values = np.asarray(data[field], dtype=np.float64)
        elif columns[0] in names:
            values = np.stack([np.asarray(data[column], dtype=np.float64) for column in columns], axis=-1)
            values = values.reshape(len(values), *dtype[field].shape)
        elif field in _NEEDED[kind]:
            raise ValueError(f"{name} has no field {field!r}: it has {', '.join(names)}")
        else:
            continue
        if filled is None:
            filled = np.full(len(values), np.nan, dtype=[(n, "f8", dtype[n].shape) for n in dtype.names or ()])
            if "intensity" in (dtype.names or ()):
                filled["intensity"] = 0.0
        if values.shape != (len(filled), *dtype[field].shape):
            raise ValueError(
                f"{field!r} of {name} has the shape {values.shape}, expected {(len(filled), *dtype[field].shape)}"
            )
        filled[field] = values
    assert filled is not None
    return filled.view("f8").reshape(len(filled), dtype.itemsize // 8)


def to_pandas(log: Log) -> Any:
    """A log as a data frame: one column for each number, such as ``position_m_x``. Every function that takes a log also
    takes such a data frame.

    Columns without any value are left out.
    """
    import pandas as pd

    columns: dict[str, Any] = {}
    for name in log.dtype.names or ():
        values = log[name].reshape(len(log), -1)
        if name != "time_s" and np.isnan(values).all():
            continue
        for at, column in enumerate(_columns(name, log.dtype[name])):
            columns[column] = values[:, at]
    return pd.DataFrame(columns)
