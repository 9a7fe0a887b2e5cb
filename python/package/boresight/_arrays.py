"""Arrays for the compiled part: contiguous float64; other arrays are copied."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def points_of(value: Any, name: str = "points") -> Array:
    """The (n, 3) array of points, an object with such ``points``, or a frame with columns of that kind."""
    array = np.ascontiguousarray(getattr(value, "points", value), dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} has the shape {array.shape}, expected (n, 3)")
    return array


def numbers_of(value: Any, name: str, length: int | None = None) -> Array:
    """A one-dimensional array, of this length if one is given."""
    array = np.ascontiguousarray(value, dtype=np.float64)
    if array.ndim != 1 or (length is not None and len(array) != length):
        wanted = "(n,)" if length is None else f"({length},)"
        raise ValueError(f"{name} has the shape {array.shape}, expected {wanted}")
    return array


def vector_of(value: Any, name: str) -> tuple[float, float, float]:
    """Three numbers."""
    array = numbers_of(value, name, 3)
    return float(array[0]), float(array[1]), float(array[2])


def positive(value: float, name: str) -> float:
    """A length above zero."""
    number = float(value)
    if not 0.0 < number < float("inf"):
        raise ValueError(f"{name} is {number}, expected a number above zero")
    return number
