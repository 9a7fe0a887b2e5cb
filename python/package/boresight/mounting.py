"""Mountings of scanners, and rotations in their usual forms."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arrays import Array, numbers_of, vector_of


def quaternion_of(rotation: Any, name: str = "rotation") -> tuple[float, float, float, float]:
    """The unit quaternion x, y, z, w of a scipy `Rotation`, four such numbers, or a 3 × 3 matrix."""
    if hasattr(rotation, "as_quat"):
        array = np.asarray(rotation.as_quat(), dtype=np.float64)
    else:
        array = np.asarray(rotation, dtype=np.float64)
        if array.shape == (3, 3):
            array = _of_matrix(array, name)
    if array.shape != (4,):
        raise ValueError(f"{name} has the shape {array.shape}, expected a Rotation, (4,) x, y, z, w, or (3, 3)")
    norm = float(np.linalg.norm(array))
    if not abs(norm - 1.0) < 1e-6:
        raise ValueError(f"{name} is a quaternion of length {norm}, expected 1")
    x, y, z, w = (float(value) for value in array)
    return x, y, z, w


def _of_matrix(matrix: Array, name: str) -> Array:
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6) or np.linalg.det(matrix) < 0.0:
        raise ValueError(f"{name} is a 3 × 3 matrix that is not a rotation")
    # Divide by the largest of the four squares, so that no digits are lost.
    trace = float(np.trace(matrix))
    squares = [matrix[0, 0], matrix[1, 1], matrix[2, 2], trace]
    largest = int(np.argmax(squares))
    quaternion = np.empty(4)
    if largest == 3:
        quaternion[3] = 1.0 + trace
        quaternion[0] = matrix[2, 1] - matrix[1, 2]
        quaternion[1] = matrix[0, 2] - matrix[2, 0]
        quaternion[2] = matrix[1, 0] - matrix[0, 1]
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        quaternion[i] = 1.0 - trace + 2.0 * matrix[i, i]
        quaternion[j] = matrix[j, i] + matrix[i, j]
        quaternion[k] = matrix[k, i] + matrix[i, k]
        quaternion[3] = matrix[k, j] - matrix[j, k]
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def rotation_of(quaternion_xyzw: npt.ArrayLike) -> Any:
    """A scipy `Rotation` (of one quaternion or of n), or the quaternions themselves if scipy is not installed."""
    try:
        from scipy.spatial.transform import Rotation
    except ImportError:
        return np.asarray(quaternion_xyzw, dtype=np.float64)
    return Rotation.from_quat(np.asarray(quaternion_xyzw, dtype=np.float64))


class Mounting:
    """Position and rotation of a scanner on the body: x_body = R x_scanner + t.

    Parameters
    ----------
    rotation
        body_from_scanner: a scipy `Rotation`, a quaternion x, y, z, w, or a 3 × 3 matrix.
    translation_m
        The scanner's origin in the body, (3,), metres.
    sigma_translation_m, sigma_rotation_deg
        Standard deviations along and about the body's axes, (3,), metres and degrees, if they are known.
    """

    quaternion_xyzw: Array
    translation_m: Array
    sigma_translation_m: Array | None
    sigma_rotation_deg: Array | None

    def __init__(
        self,
        rotation: Any,
        translation_m: npt.ArrayLike,
        *,
        sigma_translation_m: npt.ArrayLike | None = None,
        sigma_rotation_deg: npt.ArrayLike | None = None,
    ) -> None:
        def known(value: npt.ArrayLike | None, name: str) -> Array | None:
            return None if value is None else numbers_of(value, name, 3)

        self.quaternion_xyzw = np.array(quaternion_of(rotation))
        self.translation_m = np.array(vector_of(translation_m, "translation_m"))
        if not (np.isfinite(self.quaternion_xyzw).all() and np.isfinite(self.translation_m).all()):
            raise ValueError("a mounting has values that are not finite")
        self.sigma_translation_m = known(sigma_translation_m, "sigma_translation_m")
        self.sigma_rotation_deg = known(sigma_rotation_deg, "sigma_rotation_deg")

    @property
    def rotation(self) -> Any:
        """body_from_scanner as a scipy `Rotation`; the quaternion x, y, z, w if scipy is not installed."""
        return rotation_of(self.quaternion_xyzw)

    @property
    def matrix(self) -> Array:
        """The homogeneous matrix body_from_scanner, (4, 4)."""
        x, y, z, w = self.quaternion_xyzw
        matrix = np.eye(4)
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        matrix[:3, 3] = self.translation_m
        return matrix

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, as in `result.json`."""
        values: dict[str, Any] = {
            "translation_m": self.translation_m.tolist(),
            "quaternion_xyzw": self.quaternion_xyzw.tolist(),
        }
        if self.sigma_translation_m is not None:
            values["sigma_translation_m"] = self.sigma_translation_m.tolist()
        if self.sigma_rotation_deg is not None:
            values["sigma_rotation_deg"] = self.sigma_rotation_deg.tolist()
        return values

    def __repr__(self) -> str:
        return f"Mounting({self.quaternion_xyzw.tolist()}, {self.translation_m.tolist()})"

    def _repr_html_(self) -> str:
        return table([("", "x", "y", "z")], [*self._rows()])

    def _rows(self) -> list[tuple[str, ...]]:
        sigmas = [""] * 3
        if self.sigma_translation_m is not None:
            sigmas = [f" ± {1e3 * value:.2f} mm" for value in self.sigma_translation_m]
        place = [f"{value:.5f} m{sigma}" for value, sigma in zip(self.translation_m, sigmas)]
        rows: list[tuple[str, ...]] = [("translation", *place)]
        if self.sigma_rotation_deg is not None:
            rows.append(("rotation known to", *(f"± {value:.4f}°" for value in self.sigma_rotation_deg)))
        return rows


def table(head: Sequence[tuple[Any, ...]], rows: Sequence[tuple[Any, ...]], caption: str = "") -> str:
    """A table for notebooks; all text is escaped."""

    def line(cells: tuple[Any, ...], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    lines = [line(cells, "th") for cells in head] + [line(cells, "td") for cells in rows]
    title = f"<caption>{html.escape(caption)}</caption>" if caption else ""
    return f"<table>{title}{''.join(lines)}</table>"
