"""Campaigns on a cluster: the items of a campaign as tasks of a `distributed.Client`.

Dask schedules the items, and repeats those of a lost machine. Finished results are below `out`, and another call
continues from them. The module needs the packages `distributed` and `fsspec`: ``pip install 'boresight[dask]'``, or
``'boresight[s3]'`` for S3.
"""

from __future__ import annotations

import errno
import json
import os
import tempfile
import time
import uuid
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias, TypedDict

from distributed import Client, KilledWorker, as_completed, get_worker
from distributed.comm.core import CommClosedError

from . import _boresight
from ._items import Failure, run, title
from ._progress import Listener, Progress, listener
from ._tree import Look, Tree, split
from .campaigns import CampaignResult, conclude

FilePath: TypeAlias = "str | os.PathLike[str]"

# Most files and bytes that one task reads to compute their hashes.
_BATCH_FILES, _BATCH_BYTES = 64, 256 << 20
# Interval between writes of the hashes known so far, seconds.
_STORE_EVERY_S = 30.0
_HASHES = "hashes.json"


class _Done(TypedDict):
    """How an item ended."""

    title: str
    failure: Failure | None


@dataclass(frozen=True)
class _Place:
    """Folders and limits of a campaign."""

    root: Tree
    out: Tree
    memory_bytes: int | None
    threads: int
    version: str = _boresight.__version__


def campaign(
    path: FilePath,
    client: Client,
    out: FilePath | None = None,
    *,
    storage_options: dict[str, Any] | None = None,
    memory_mb: int | None = None,
    threads: int = 1,
    retries: int = 2,
    progress: Progress = "tqdm",
) -> CampaignResult:
    """Processes all items of a campaign on the workers of a Dask cluster; finished items are not processed again.

    Each item runs in a process of its own beside its worker. If an item fails, the result names it, the other items
    continue, and the next call tries it again.

    Parameters
    ----------
    path
        A `campaign.toml`: a path that all workers see, or a URL of a file system that fsspec knows, such as
        ``"s3://bucket/beets/campaign.toml"``.
    client
        The cluster.
    out
        Folder of the results, a path or a URL; by default `out` beside the campaign file.
    storage_options
        Options of the file systems of URLs, as in fsspec.
    memory_mb
        Memory of an item, MB: an item that needs more fails without affecting the others. By default the memory of its
        worker divided by the worker's threads.
    threads
        Threads of an item. A worker runs as many items at once as it has Dask threads.
    retries
        Number of times that an item is tried again if its worker could not read or write, or was lost.
    """
    folder, name = split(path)
    options = storage_options or {}
    target = Tree(f"{folder}/out" if out is None else _absolute(out), options)
    if memory_mb is not None:
        _boresight.campaign_check_memory(memory_mb, threads or 1)
    place = _Place(Tree(folder, options), target, None if memory_mb is None else 1_000_000 * memory_mb, threads)
    with listener(progress) as told, tempfile.TemporaryDirectory(prefix="boresight-") as scratch:
        planned = _Planned(place, name, Path(scratch))
        items = planned.items(_hashes(planned.looks(), place, client, retries, told))
        _finish([json.loads(text) for text in items], place, client, retries, told)
        return planned.conclude(items)


def _absolute(out: FilePath) -> str:
    text = os.fspath(out)
    return text.rstrip("/") if "://" in text else os.path.abspath(text)


class _Planned:
    """The plan of a campaign. The texts of a remote campaign are copied to `scratch`."""

    def __init__(self, place: _Place, name: str, scratch: Path) -> None:
        self._place = place
        self._scratch = scratch
        root = place.root.local
        # Sizes and stamps of all files of a remote campaign.
        self._listed: dict[str, Look] | None = None
        if root is None:
            root = str(scratch / "root")
            self._listed = place.root.files(without=place.out.url.removeprefix(f"{place.root.url}/"))
            if name not in self._listed:
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), f"{place.root.url}/{name}")
            place.root.fetch([name], Path(root))
        self._toml = os.path.join(root, name)
        listing = None if self._listed is None else list(self._listed)
        if listing is not None:
            place.root.fetch(_boresight.campaign_texts(self._toml, listing), Path(root))
        self._plan = _boresight.CampaignPlan(self._toml, listing, place.out.local)

    def looks(self) -> dict[str, Look]:
        """Sizes and stamps of the files that items read; missing files are left out."""
        files = self._plan.files()
        if self._listed is not None:
            return {file: self._listed[file] for file in files if file in self._listed}
        found = {file: self._place.root.look(file) for file in files}
        return {file: look for file, look in found.items() if look is not None}

    def items(self, hashes: dict[str, str]) -> list[str]:
        """The items as JSON, each after those that it needs."""
        return self._plan.items(hashes)

    def conclude(self, items: list[str]) -> CampaignResult:
        """Writes the index and the page."""
        target, out = self._place.out, self._place.out.local
        if out is not None:
            return conclude(self._toml, items, out, out)[0]
        mirror = self._scratch / "out"
        found = target.files("items") | target.files("failed")
        target.fetch((file for file in found if file.endswith(".json")), mirror)
        result, written = conclude(self._toml, items, str(mirror), target.url)
        target.store(mirror, written)
        return result


def _hashes(looks: dict[str, Look], place: _Place, client: Client, retries: int, told: Listener) -> dict[str, str]:
    """Hashes of the contents of files. Those that an earlier call computed are reused; workers compute the others."""
    try:
        kept: dict[str, dict[str, Any]] = json.loads(place.out.read(_HASHES) or b"{}")
    except ValueError:
        kept = {}
    known = {file: kept[file]["hash"] for file, look in looks.items() if look == _look_of(kept.get(file, {}))}
    batches = list(_batches((file, look["bytes"]) for file, look in looks.items() if file not in known))
    if not batches:
        return known
    run = uuid.uuid4().hex[:8]
    futures = client.map(
        _hash,
        batches,
        tree=place.root,
        key=[f"boresight-hash-{run}-{number}" for number in range(len(batches))],
        retries=retries,
    )

    def store() -> None:
        document = {file: looks[file] | {"hash": digits} for file, digits in sorted(known.items())}
        place.out.write(json.dumps(document, indent=2).encode() + b"\n", _HASHES)

    total = sum(looks[file]["bytes"] for batch in batches for file in batch)
    done, stored = 0, time.monotonic()
    told.stage("reading inputs", done, total)
    for _, found in as_completed(futures, with_results=True):
        known |= {file: digits for file, digits in found.items() if digits is not None}
        done += sum(looks[file]["bytes"] for file in found)
        told.stage("reading inputs", done, total)
        if time.monotonic() - stored > _STORE_EVERY_S:
            store()
            stored = time.monotonic()
    store()
    return known


def _look_of(kept: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in kept.items() if key != "hash"}


def _batches(sized: Iterable[tuple[str, int]]) -> Iterator[list[str]]:
    batch: list[str] = []
    bytes = 0
    for file, size in sized:
        if batch and (len(batch) == _BATCH_FILES or bytes + size > _BATCH_BYTES):
            yield batch
            batch, bytes = [], 0
        batch.append(file)
        bytes += size
    if batch:
        yield batch


def _hash(files: list[str], tree: Tree) -> dict[str, str | None]:
    """Hashes of the contents of files, `None` for an unreadable file; the items that need it report why."""
    found: dict[str, str | None] = {}
    for file in files:
        try:
            found[file] = tree.hash(file)
        except (FileNotFoundError, PermissionError):
            found[file] = None
    return found


def _finish(items: list[dict[str, Any]], place: _Place, client: Client, retries: int, told: Listener) -> None:
    """Processes the items that are not finished."""
    finished = _finished(items, place.out)
    waiting = [item for item in items if item["name"] not in finished]
    done = len(items) - len(waiting)
    told.stage("items", done, len(items))
    futures: dict[str, Any] = {}
    run = uuid.uuid4().hex[:8]
    for level in _levels(waiting):
        # Dask groups tasks by the part of the key before the second hyphen.
        keys = [f"boresight-{item['kind']}-{run}-{item['name']}" for item in level]
        needs = [[futures[name] for name in item["needs"] if name in futures] for item in level]
        submitted = client.map(_do, level, needs, place=place, key=keys, retries=retries)
        futures |= {item["name"]: future for item, future in zip(level, submitted)}
    by_key = {futures[item["name"]].key: item for item in waiting}
    titles = {item["name"]: title(item) for item in waiting}
    for future, result in as_completed(futures.values(), with_results=True, raise_errors=False):
        item = by_key[future.key]
        if future.status == "cancelled":
            raise ConnectionError("the connection to the scheduler is lost; finished items are kept: call again")
        if future.status == "error":
            lost = [titles[need] for need in item["needs"] if need in futures and futures[need].status == "error"]
            _record(item, place.out, _lost(future.exception(), lost))
        elif result["failure"] is None:
            finished.add(item["name"])
        done += 1
        told.stage("items", done, len(items))
    _forget_failures({item["name"] for item in items} - finished, place.out)


def _forget_failures(failed: set[str], out: Tree) -> None:
    """Removes the recorded failures of all other items, as the conclusion does for a local campaign."""
    if out.local is None:
        out.remove(file for file in out.files("failed") if Path(file).stem not in failed)


def _finished(items: list[dict[str, Any]], out: Tree) -> set[str]:
    names = {item["name"] for item in items}
    if out.local is not None:
        return {name for name in names if os.path.exists(out.path(f"items/{name}/result.json"))}
    found = out.files("items")
    return {name for name in names if f"items/{name}/result.json" in found}


def _levels(items: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Items in levels: each waits only for items of earlier levels."""
    depth: dict[str, int] = {}
    levels: list[list[dict[str, Any]]] = []
    for item in items:
        at = max((depth[name] + 1 for name in item["needs"] if name in depth), default=0)
        depth[item["name"]] = at
        if at == len(levels):
            levels.append([])
        levels[at].append(item)
    return levels


def _do(item: dict[str, Any], needs: list[_Done], place: _Place) -> _Done:
    """A task: processes an item, and records the reason if it fails."""
    if place.version != _boresight.__version__:
        raise RuntimeError(f"a worker has boresight {_boresight.__version__}, expected {place.version} on all workers")
    failed = [need["title"] for need in needs if need["failure"] is not None]
    failure = None
    if failed:
        failure = _blocked(failed)
    # A lost worker may have finished the item without reporting it.
    elif not place.out.has(f"items/{item['name']}/result.json"):
        failure = _in_place(item, place)
    if failure is not None:
        _record(item, place.out, failure)
    return {"title": title(item), "failure": failure}


def _in_place(item: dict[str, Any], place: _Place) -> Failure | None:
    """Processes an item. Remote inputs are copied to this machine first, and the results are copied back."""
    worker = get_worker()
    root, out = place.root.local, place.out.local
    memory_bytes = place.memory_bytes
    if memory_bytes is None and (shared := worker.memory_manager.memory_limit):
        memory_bytes = int(shared) // worker.state.nthreads
    with tempfile.TemporaryDirectory(prefix="boresight-", dir=worker.local_directory) as scratch:
        if root is None:
            root = os.path.join(scratch, "root")
            inputs = {input["path"]: input["hash"] for input in item["inputs"] if input["hash"] is not None}
            place.root.fetch(inputs, Path(root))
        if out is None:
            needed = [file for name in item["needs"] for file in place.out.files(f"items/{name}")]
            place.out.fetch(needed, Path(scratch) / "out")
        failure = run(json.dumps(item), root, out or os.path.join(scratch, "out"), memory_bytes, place.threads)
        if failure is None and out is None:
            folder = f"items/{item['name']}"
            made = [file for file in Tree(os.path.join(scratch, "out")).files(folder)]
            result = f"{folder}/result.json"
            place.out.store(Path(scratch) / "out", (file for file in made if file != result))
            place.out.store(Path(scratch) / "out", [result])
    return failure


def _record(item: dict[str, Any], out: Tree, failure: Failure) -> None:
    document = {key: item[key] for key in ("name", "kind", "plot", "date")} | {"error": failure}
    text = json.dumps(document, indent=2, sort_keys=True, ensure_ascii=False)
    out.write(text.encode() + b"\n", f"failed/{item['name']}.json")


def _blocked(failed: list[str]) -> Failure:
    return {"problem": f"not tried, as it needs {failed[0]}, which failed", "remedy": None}


def _lost(error: BaseException, needs: list[str]) -> Failure:
    if needs:
        return _blocked(needs)
    if isinstance(error, (KilledWorker, CommClosedError)):
        return {"problem": f"lost with its worker: {error}", "remedy": "call again"}
    return {"problem": str(error) or type(error).__name__, "remedy": None}
