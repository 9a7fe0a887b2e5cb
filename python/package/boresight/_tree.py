"""Folders on any file system that fsspec knows."""

from __future__ import annotations

import os
import tempfile
import uuid
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import fsspec
from fsspec.implementations.local import LocalFileSystem

from ._boresight import ContentHash

# Bytes read at a time.
_BLOCK = 8 << 20
# In these, an object appears whole or not at all. Elsewhere, a file gets its name when its upload is complete.
_OBJECT_STORES = {"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "memory"}
# Values that change when a file is written again, by file system; the first one that is present counts.
_STAMPS = ("ETag", "etag", "md5Hash", "content_md5", "mtime", "LastModified", "last_modified", "updated", "created")


def split(url: str | os.PathLike[str]) -> tuple[str, str]:
    """The folder and the name of a file: an absolute path, or a URL."""
    text = os.fspath(url)
    if "://" not in text:
        path = Path(text).absolute()
        return str(path.parent), path.name
    folder, _, name = text.rpartition("/")
    return folder, name


# Size of a file and a stamp that changes when it is written again: they identify its content without reading it.
Look: TypeAlias = "dict[str, Any]"


@dataclass(frozen=True)
class Tree:
    """A folder that can be sent between processes; paths are relative to it, with ``/`` between folders."""

    url: str
    options: dict[str, Any] = field(default_factory=dict, hash=False, repr=False)

    @cached_property
    def _opened(self) -> tuple[Any, str]:
        fs, path = fsspec.core.url_to_fs(self.url, **(self.options if "://" in self.url else {}))
        return fs, path.rstrip("/")

    def __getstate__(self) -> dict[str, Any]:
        return {"url": self.url, "options": self.options}

    @property
    def local(self) -> str | None:
        """The path of the folder, if it is on this machine or mounted; else `None`."""
        fs, path = self._opened
        return path if isinstance(fs, LocalFileSystem) else None

    def path(self, name: str) -> str:
        """A path of the file system."""
        return os.path.join(self._opened[1], name)

    def has(self, name: str) -> bool:
        """Whether a file is there."""
        fs, _ = self._opened
        fs.invalidate_cache()
        return bool(fs.exists(self.path(name)))

    def look(self, name: str) -> Look | None:
        """Size and stamp of a file of this machine; `None` if there is none."""
        try:
            status = os.stat(self.path(name))
        except OSError:
            return None
        return {"bytes": status.st_size, "changed_ns": status.st_mtime_ns}

    def files(self, below: str = "", without: str | None = None) -> dict[str, Look]:
        """All files with size and stamp, except hidden ones and those below `without`."""
        fs, top = self._opened
        folder = self.path(below) if below else top
        # Other processes write there too.
        fs.invalidate_cache()
        if not fs.exists(folder):
            return {}
        found = {}
        for entry in fs.ls(folder, detail=True):
            name = self._relative(entry["name"])
            # There can be many times as many results as inputs, so they are not even listed.
            if name == without or name.rpartition("/")[2].startswith("."):
                continue
            inside = fs.find(entry["name"], detail=True).values() if entry["type"] == "directory" else [entry]
            for info in inside:
                file = self._relative(info["name"])
                if info["type"] == "file" and not any(part.startswith(".") for part in file.split("/")):
                    found[file] = {"bytes": int(info["size"] or 0), "stamp": _stamp(info)}
        return found

    def _relative(self, path: str) -> str:
        return path.rstrip("/").removeprefix(f"{self._opened[1]}/")

    def fetch(self, names: Iterable[str], to: Path) -> None:
        """Copies files into a folder, at the same relative paths."""
        names = list(names)
        for name in names:
            (to / name).parent.mkdir(parents=True, exist_ok=True)
        if names:
            self._opened[0].get([self.path(name) for name in names], [str(to / name) for name in names])

    def store(self, folder: Path, names: Iterable[str]) -> None:
        """Copies files of a folder to the same relative paths; each appears only when it is complete."""
        fs, _ = self._opened
        names = list(names)
        sources, targets = [str(folder / name) for name in names], [self.path(name) for name in names]
        protocols = {fs.protocol} if isinstance(fs.protocol, str) else set(fs.protocol)
        if protocols & _OBJECT_STORES:
            if names:
                fs.put(sources, targets)
            return
        for source, target in zip(sources, targets):
            fs.makedirs(target.rpartition("/")[0], exist_ok=True)
            part = f"{target}.{uuid.uuid4().hex}.part"
            fs.put_file(source, part)
            fs.mv(part, target)

    def write(self, data: bytes, name: str) -> None:
        """Writes a small file, which appears only when it is complete."""
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder) / name
            source.parent.mkdir(parents=True, exist_ok=True)
            source.write_bytes(data)
            self.store(Path(folder), [name])

    def read(self, name: str) -> bytes | None:
        """The content of a small file; `None` if there is none."""
        try:
            content: bytes = self._opened[0].cat_file(self.path(name))
        except FileNotFoundError:
            return None
        return content

    def remove(self, names: Iterable[str]) -> None:
        """Removes files."""
        paths = [self.path(name) for name in names]
        if paths:
            self._opened[0].rm(paths)

    def hash(self, name: str) -> str:
        """The hash of a file's content."""
        found = ContentHash()
        with self._opened[0].open(self.path(name), "rb", block_size=_BLOCK) as file:
            while block := file.read(_BLOCK):
                found.update(block)
        return found.digits()


def _stamp(info: dict[str, Any]) -> str:
    # Without a stamp, the file counts as new.
    return next((str(info[key]) for key in _STAMPS if info.get(key)), uuid.uuid4().hex)
