"""Exceptions and warnings of the package.

A file that cannot be opened raises `OSError` (`FileNotFoundError`, `PermissionError`, ...), and an array of a wrong
shape raises `ValueError`; every other error is an `Error`.
"""

from __future__ import annotations

import os


class Error(Exception):
    """An error of boresight; its text says what was found, what was expected, and where."""


class FormatError(Error):
    """The content of a file does not match its format."""

    path: str
    line: int | None
    """Line of a text file, counted from 1."""
    byte: int | None
    """Byte of a binary file, counted from 0."""
    row: int | None
    """Row of a binary table, counted from 1."""
    found: str
    expected: str


class DataError(Error):
    """Readable data that cannot be used together, or not for this purpose."""

    remedy: str
    """What the user can do about it."""


class InvalidError(DataError, ValueError):
    """A value or setting that is not finite, out of range, out of order or in the wrong unit."""


class NoOverlapError(DataError):
    """Streams that do not overlap in time, or clouds that do not overlap in space."""


class TooFewError(DataError):
    """Too few data for the method."""


class TooManyError(DataError, MemoryError):
    """More data than memory can hold."""


class NotDeterminedError(DataError):
    """Unknowns that the data do not determine."""


class WouldReplaceInputError(DataError):
    """A result that would overwrite one of its inputs."""


class BoresightWarning(UserWarning):
    """A problem that needs the user's attention, although there is a result."""


_DATA = {
    "Invalid": InvalidError,
    "NoOverlap": NoOverlapError,
    "TooFew": TooFewError,
    "TooMany": TooManyError,
    "NotDetermined": NotDeterminedError,
    "WouldReplaceInput": WouldReplaceInputError,
}


def _io(number: int | None, kind: str, text: str, path: str | os.PathLike[str]) -> OSError:
    name = os.fspath(path)
    if number is not None:
        # Python chooses the class by the number.
        return OSError(number, os.strerror(number), name)
    classes = {"NotFound": FileNotFoundError, "AlreadyExists": FileExistsError, "PermissionDenied": PermissionError}
    return classes.get(kind, OSError)(f"{name}: {text}")


def _format(
    text: str, path: str | os.PathLike[str], place: str | None, number: int, found: str, expected: str
) -> FormatError:
    error = FormatError(text)
    error.path, error.found, error.expected = os.fspath(path), found, expected
    error.line = number if place == "line" else None
    error.byte = number if place == "byte" else None
    error.row = number if place == "row" else None
    return error


def _data(kind: str, problem: str, remedy: str) -> DataError:
    error = _DATA.get(kind, DataError)(f"{problem}\n  remedy: {remedy}")
    error.remedy = remedy
    return error
