"""Reports during the work: stages go to bars or a function, messages to logging, warnings to `warnings`."""

from __future__ import annotations

import inspect
import logging
import warnings
from collections.abc import Callable
from typing import Any, Literal, TypeAlias

from .errors import BoresightWarning

Progress: TypeAlias = "Callable[[str, int, int], object] | Literal['tqdm'] | None"

_LOGGER = logging.getLogger("boresight")
# Shorter work has no bar, seconds.
_DELAY_S = 1.0


class Listener:
    """Passes on the reports of the compiled part; without a function, it ignores stages."""

    def __init__(self, function: Callable[[str, int, int], object] | None) -> None:
        self._function = function

    def stage(self, name: str, done: int, total: int) -> None:
        if self._function is not None:
            self._function(name, done, total)

    def say(self, text: str) -> None:
        _LOGGER.info("%s", text)

    def warn(self, text: str) -> None:
        # The warning names the line outside the package that called it.
        level, frame = 2, inspect.currentframe()
        frame = frame.f_back if frame else None
        while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "boresight":
            level, frame = level + 1, frame.f_back
        warnings.warn(text, BoresightWarning, stacklevel=level)

    def close(self) -> None:
        pass

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Bars(Listener):
    """A bar for the running stage."""

    def __init__(self, tqdm: Any) -> None:
        super().__init__(None)
        self._tqdm = tqdm
        self._bar: Any = None
        self._name = ""

    def stage(self, name: str, done: int, total: int) -> None:
        if self._bar is None or name != self._name or (self._bar.total or 0) != total:
            self.close()
            self._name = name
            self._bar = self._tqdm(total=total or None, desc=name, delay=_DELAY_S, unit_scale=True, leave=False)
        if done != self._bar.n:
            self._bar.update(done - self._bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def listener(progress: Progress) -> Listener:
    """The listener for the argument `progress`."""
    if progress is None or callable(progress):
        return Listener(progress)
    if progress != "tqdm":
        raise ValueError(f"progress={progress!r}, expected a function, 'tqdm' or None")
    try:
        with warnings.catch_warnings():
            # In a notebook without widgets, bars are text, and tqdm warns of it.
            warnings.simplefilter("ignore")
            from tqdm.auto import tqdm
    except ImportError:
        return Listener(None)
    return _Bars(tqdm)
