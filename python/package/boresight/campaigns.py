"""Campaigns: many plots on many dates. `boresight.dask` runs them on a cluster."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, TypeAlias

from . import _boresight
from ._items import command
from ._progress import Progress, listener
from .mounting import table

FilePath: TypeAlias = "str | os.PathLike[str]"

# Number of failures that a notebook shows.
_ROWS = 30


class CampaignResult:
    """The result of a campaign.

    Attributes
    ----------
    summary
        A few lines of text.
    out
        The folder of the results: a path or a URL.
    items
        All items: ``name``, ``kind``, ``plot``, ``date``, ``before`` and ``state``, which is ``finished``, ``failed``
        or ``waiting``. The results of a finished item are in ``items/<name>`` below `out`.
    failed
        The items that failed, also with ``problem`` and ``remedy``.
    """

    summary: str
    out: str
    items: list[dict[str, Any]]
    failed: list[dict[str, Any]]

    def __init__(self, document: dict[str, Any], summary: str, out: str, failures: dict[str, dict[str, Any]]) -> None:
        self._document = document
        self.summary = summary
        self.out = out
        self.items = document["items"]
        self.failed = [item | failures[item["name"]] for item in self.items if item["state"] == "failed"]

    @property
    def page(self) -> str:
        """The page: quality over time, changes and failures."""
        return f"{self.out}/campaign.html"

    @property
    def index(self) -> str:
        """The index of all tiles, GeoParquet."""
        return f"{self.out}/index.parquet"

    def to_dict(self) -> dict[str, Any]:
        """The whole result, as in `campaign.json`."""
        return self._document

    def __repr__(self) -> str:
        return f"<CampaignResult: {self.summary}>"

    def _repr_html_(self) -> str:
        rows = [
            (item["kind"], item["plot"] or "", item["date"] or "", item["problem"], item["remedy"] or "")
            for item in self.failed[:_ROWS]
        ]
        head = [("item", "plot", "date", "what is wrong", "what can be done")] if rows else []
        return table(head, rows, f"{self.summary.splitlines()[0]}: {self.page}")


def conclude(path: str, items: list[str], out: str, shown: str) -> tuple[CampaignResult, list[str]]:
    """Writes index and page into the folder `out`, and returns the result and the names of the files. The result has
    `shown` as its folder."""
    document, summary, files = _boresight.campaign_conclude(path, items, out)
    found = json.loads(document)
    failures = {}
    for item in found["items"]:
        if item["state"] == "failed":
            text = Path(out, "failed", f"{item['name']}.json").read_text(encoding="utf-8")
            failures[item["name"]] = json.loads(text)["error"]
    return CampaignResult(found, summary, shown, failures), [os.path.relpath(file, out) for file in files]


def campaign(
    path: FilePath,
    out: FilePath | None = None,
    *,
    workers: int | None = None,
    memory_mb: int | None = None,
    progress: Progress = "tqdm",
) -> CampaignResult:
    """Processes all items of a campaign on this machine, like the command `boresight campaign`; finished items are not
    processed again.

    Parameters
    ----------
    path
        A `campaign.toml`.
    out
        Folder of the results; by default `out` beside the campaign file.
    workers
        Number of items at the same time; by default one per core, as far as memory allows.
    memory_mb
        Memory of an item, MB: an item that needs more fails without affecting the others. By default an even share of
        the free memory.
    """
    toml = os.path.abspath(path)
    root = os.path.dirname(toml)
    target = os.path.join(root, "out") if out is None else os.path.abspath(out)
    wanted, threads, megabytes = _boresight.campaign_share(os.cpu_count() or 1, workers, memory_mb)
    limit = 1_000_000 * megabytes
    with listener(progress) as told:
        plan = _boresight.CampaignPlan(toml, None, target)
        hashes = _boresight.campaign_hashes(plan.files(), root, target, told, None)
        items = plan.items(hashes)
        program = command(root, target, limit, threads)
        _boresight.campaign_pool(items, target, wanted, limit, program, told)
        return conclude(toml, items, target, target)[0]
