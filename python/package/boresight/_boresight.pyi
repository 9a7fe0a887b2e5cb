from os import PathLike
from pathlib import Path
from typing import Any, final

import numpy as np
import numpy.typing as npt

from ._progress import Listener

_Array = npt.NDArray[np.float64]
_Path = str | PathLike[str]
_Scanner = tuple[str, list[float], list[float]]
_Told = tuple[str, str, list[Path]]

__all__ = [
    "CampaignPlan",
    "ContentHash",
    "Smoothed",
    "__version__",
    "campaign_check_memory",
    "campaign_clean",
    "campaign_conclude",
    "campaign_hashes",
    "campaign_pool",
    "campaign_share",
    "campaign_texts",
    "campaign_work",
    "command",
    "default_features",
    "detect",
    "feature_columns",
    "features",
    "georeference",
    "m3c2",
    "read_cloud",
    "read_log",
    "read_mountings",
    "simulate",
    "smooth_logs",
    "smooth_project",
    "thin",
    "write_cloud",
    "write_log",
    "write_mountings",
]

__version__: str

@final
class Smoothed:
    def poses(self) -> _Array: ...
    def result(self) -> str: ...
    def covariance(self, indices: list[int]) -> _Array | None: ...

def feature_columns() -> list[tuple[str, list[str]]]: ...
def default_features() -> list[str]: ...
def features(
    points: _Array,
    names: list[str],
    neighbours: int,
    radius_m: float | None,
    listener: Listener,
    threads: int | None,
) -> npt.NDArray[np.uint32]: ...
def thin(points: _Array, voxel_m: float, listener: Listener, threads: int | None) -> npt.NDArray[np.uint32]: ...
def m3c2(
    reference: _Array,
    compared: _Array,
    core: _Array | None,
    normals: _Array | None,
    settings: dict[str, Any],
    listener: Listener,
    threads: int | None,
) -> dict[str, Any]: ...
def georeference(
    points: _Array,
    times_s: _Array,
    poses: _Array,
    mounting: tuple[tuple[float, float, float, float], tuple[float, float, float]],
    time_offset_s: float,
    listener: Listener,
    threads: int | None,
) -> _Array: ...
def detect(path: _Path) -> tuple[str, list[str]]: ...
def read_cloud(
    path: _Path, listener: Listener, threads: int | None
) -> tuple[_Array, dict[str, npt.NDArray[Any]], str | None]: ...
def write_cloud(
    path: _Path,
    points: _Array,
    attributes: list[tuple[str, str, _Array]],
    wkt: str | None,
    listener: Listener,
    threads: int | None,
) -> None: ...
def read_log(path: _Path, kind: str, crs: str | None, axes: str, listener: Listener, threads: int | None) -> _Array: ...
def write_log(
    path: _Path, kind: str, rows: _Array, crs: str | None, listener: Listener, threads: int | None
) -> None: ...
def read_mountings(path: _Path, listener: Listener) -> list[_Scanner]: ...
def write_mountings(path: _Path, scanners: list[_Scanner], body: str, listener: Listener) -> None: ...
def smooth_project(project: _Path, listener: Listener, threads: int | None) -> Smoothed: ...
def smooth_logs(
    imu: _Array,
    positions: _Array,
    heading: _Array,
    settings: dict[str, Any],
    listener: Listener,
    threads: int | None,
) -> Smoothed: ...
def command(
    name: str,
    project: _Path,
    out: _Path | None,
    fresh: bool,
    method: str | None,
    calibration: _Path | None,
    trajectory: _Path | None,
    listener: Listener,
    threads: int | None,
) -> _Told: ...
def simulate(
    scenario: str, out: _Path, seed: int | None, force: bool, listener: Listener, threads: int | None
) -> _Told: ...

@final
class ContentHash:
    def __new__(cls) -> ContentHash: ...
    def update(self, bytes: bytes) -> None: ...
    def digits(self) -> str: ...

@final
class CampaignPlan:
    def __new__(cls, path: _Path, listing: list[str] | None, out: _Path | None) -> CampaignPlan: ...
    def files(self) -> list[str]: ...
    def items(self, hashes: dict[str, str]) -> list[str]: ...

def campaign_share(cores: int, workers: int | None, memory_mb: int | None) -> tuple[int, int, int]: ...
def campaign_check_memory(memory_mb: int, threads: int) -> None: ...
def campaign_texts(path: _Path, listing: list[str]) -> list[str]: ...
def campaign_hashes(
    files: list[str], root: _Path, out: _Path, listener: Listener, threads: int | None
) -> dict[str, str]: ...
def campaign_work(
    text: str, root: _Path, out: _Path, memory_bytes: int | None, listener: Listener, threads: int | None
) -> str | None: ...
def campaign_clean(text: str, out: _Path) -> None: ...
def campaign_pool(
    texts: list[str], out: _Path, workers: int, memory_bytes: int, command: list[str], listener: Listener
) -> tuple[int, int, int]: ...
def campaign_conclude(path: _Path, texts: list[str], out: _Path) -> _Told: ...
