"""Calibration of laser profile scanners on a moving platform, and processing of their point clouds.

Lengths are in metres, angles in radians unless a name ends in ``_deg``, times in seconds. Points are arrays of shape
(n, 3): east, north, up. Functions take rotations as `scipy.spatial.transform.Rotation`, as quaternions x, y, z, w or
as 3 × 3 matrices. While a function works, other threads of Python can run, and Ctrl-C stops it.

Every function that may take long has two more arguments:

``progress``
    A function called as ``progress(stage, done, total)`` (``total`` is 0 if unknown), or ``None`` for no output; by
    default a bar of `tqdm`, if it is installed.
``threads``
    Number of threads; one per core by default. Results do not depend on it.
"""

from importlib import import_module as _import_module
from types import ModuleType as _ModuleType

from ._boresight import __version__
from .campaigns import CampaignResult, campaign
from .clouds import (
    DEFAULT_FEATURES,
    FEATURES,
    Cloud,
    M3C2Result,
    features,
    georeference,
    m3c2,
    thin,
)
from .drives import (
    Calibration,
    Georeferenced,
    Result,
    Run,
    Simulation,
    Trajectory,
    calibrate,
    georeference_project,
    run,
    simulate,
    smooth,
)
from .errors import (
    BoresightWarning,
    DataError,
    Error,
    FormatError,
    InvalidError,
    NoOverlapError,
    NotDeterminedError,
    TooFewError,
    TooManyError,
    WouldReplaceInputError,
)
from .files import detect, read, write
from .logs import HEADING, IMU, POSITIONS, PROFILES, TRAJECTORY, to_pandas
from .mounting import Mounting

__all__ = [
    "DEFAULT_FEATURES",
    "FEATURES",
    "HEADING",
    "IMU",
    "POSITIONS",
    "PROFILES",
    "TRAJECTORY",
    "BoresightWarning",
    "Calibration",
    "CampaignResult",
    "Cloud",
    "DataError",
    "Error",
    "FormatError",
    "Georeferenced",
    "InvalidError",
    "M3C2Result",
    "Mounting",
    "NoOverlapError",
    "NotDeterminedError",
    "Result",
    "Run",
    "Simulation",
    "TooFewError",
    "TooManyError",
    "Trajectory",
    "WouldReplaceInputError",
    "__version__",
    "calibrate",
    "campaign",
    "detect",
    "features",
    "georeference",
    "georeference_project",
    "m3c2",
    "read",
    "run",
    "simulate",
    "smooth",
    "thin",
    "to_pandas",
    "write",
]


def __getattr__(name: str) -> _ModuleType:
    """Imports a module that needs more packages when it is first used."""
    if name in ("dask", "plot", "py4dgeo"):
        return _import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
