"""A campaign of 200 items by the pool and on Dask, with accidents, on local disk and on S3; prints tables.

    python benches/campaign.py [--plots 10] [--dates 10] [--only bytes,restart,scaling,s3,tasks]

Needs the packages `distributed`, `s3fs` and `moto[server]`. One profile file is cut short and one item needs more
memory than it may have: both must fail, with the changes that need them, and everything else must finish with the same
bytes.

bytes    the pool of processes; then Dask with two workers, of which one is killed (SIGKILL) after a third of the items
restart  scheduler and client are killed (SIGKILL) after half of the items; the same call again does the others only
scaling  part of the campaign with one worker and with two
s3       that part with inputs and outputs in an S3 that moto serves on this machine, and what it serves at most
tasks    what Dask itself costs: tasks that do nothing, with the dependencies of a campaign
"""

from __future__ import annotations

import argparse
import logging
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import boresight
import boresight.dask
import psutil
from distributed import Client, LocalCluster, as_completed

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from simulated_campaign import Campaign, contents, make, truncate

MEMORY_MB = 260


def cluster(workers: int) -> LocalCluster:
    return LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL)


def load() -> str:
    return f"load {os.getloadavg()[0]:.1f}"


def finished(out: Path) -> dict[str, int]:
    """Items that are finished, with the times at which they were."""
    return {path.parent.name: path.stat().st_mtime_ns for path in out.glob("items/*/result.json")}


def when(is_so: Callable[[], bool], do: Callable[[], Any]) -> threading.Thread:
    """Does something once something is so."""

    def wait() -> None:
        while not is_so():
            time.sleep(0.05)
        do()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread


def on_dask(made: Campaign, out: str | Path, workers: int, **more: Any) -> tuple[boresight.CampaignResult, float]:
    with cluster(workers) as processes, Client(processes) as client:
        started = time.perf_counter()
        path = more.pop("path", made.path)
        found = boresight.dask.campaign(path, client, out, memory_mb=MEMORY_MB, progress=None, **more)
        return found, time.perf_counter() - started


def working(out: Path) -> int:
    """Processes that do items."""
    processes = psutil.process_iter(["cmdline"])
    return sum(str(out) in " ".join(process.info["cmdline"] or []) for process in processes)


def told(found: boresight.CampaignResult) -> str:
    return f"{len(found.items)} items, {len(found.failed)} failed"


def bytes_and_a_killed_worker(made: Campaign, folder: Path) -> None:
    started = time.perf_counter()
    pool = boresight.campaign(made.path, folder / "pool", workers=2, memory_mb=MEMORY_MB, progress=None)
    print(f"pool, 2 workers        {time.perf_counter() - started:7.1f} s  {told(pool)}  {load()}", flush=True)
    out, killed = folder / "dask", []
    with cluster(2) as processes, Client(processes) as client:
        pids = list(client.run(os.getpid).values())

        def kill() -> None:
            killed.append(pids[0])
            os.kill(pids[0], signal.SIGKILL)

        thread = when(lambda: len(finished(out)) > len(pool.items) // 3, kill)
        started = time.perf_counter()
        found = boresight.dask.campaign(made.path, client, out, memory_mb=MEMORY_MB, progress=None)
        seconds = time.perf_counter() - started
        thread.join()
    print(f"Dask, 2 workers, 1 killed {seconds:4.1f} s  {told(found)}  {load()}")
    ours, theirs = contents(out), contents(Path(pool.out))
    assert killed and ours == theirs, sorted(set(ours.items()) ^ set(theirs.items()))[:5]
    assert [item["name"] for item in found.failed] == [item["name"] for item in pool.failed]
    page = Path(found.page).read_text()
    for item in found.failed:
        print(f"  {item['kind']} {item['plot']} {item['date']}: {item['problem']}")
        assert item["plot"] in page and item["date"] in page
    print(f"  {len(ours)} files have the same bytes; no other is there", flush=True)


def restarted(made: Campaign, folder: Path) -> None:
    out = folder / "restarted"
    run = [sys.executable, __file__, "--call", str(made.path), str(out)]
    first = subprocess.Popen(run, stderr=subprocess.DEVNULL)
    items = len(made.plots) * len(made.dates) * 2
    when(lambda: len(finished(out)) > items // 2, first.kill).join()
    first.wait()
    killed = time.perf_counter()
    while working(out):
        assert time.perf_counter() - killed < 60.0, "processes of items still work"
        time.sleep(0.1)
    ended = time.perf_counter() - killed
    before = finished(out)
    left = [str(path.relative_to(out)) for path in out.rglob("*") if ".staging" in path.name or path.suffix == ".part"]
    subprocess.run(run, check=True)
    after = finished(out)
    again = [name for name in before if after[name] != before[name]]
    print(f"scheduler and client killed: the last process of an item ended {ended:.1f} s later", flush=True)
    print(
        f"  {len(before)} items were finished, {len(after) - len(before)} were done by the next "
        f"call, {len(again)} again; {len(left)} files of unfinished items were left  {load()}",
        flush=True,
    )
    assert not again and contents(out) == contents(folder / "pool")


def scaling(part: Campaign, folder: Path) -> dict[int, float]:
    seconds = {}
    for workers in (1, 2):
        found, seconds[workers] = on_dask(part, folder / f"workers{workers}", workers)
        print(
            f"Dask, {workers} worker{'s'[: workers - 1]}  {seconds[workers]:7.1f} s  {told(found)}  {load()}",
            flush=True,
        )
    print(f"  2 workers are {seconds[1] / seconds[2]:.2f} times as fast as 1")
    assert contents(folder / "workers1") == contents(folder / "workers2")
    return seconds


def on_s3(part: Campaign, folder: Path) -> None:
    import s3fs

    port = 5555
    # A process of its own: it shall not wait for the scheduler.
    script = f"from moto.server import main; main(['-H', '127.0.0.1', '-p', '{port}'])"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    served = subprocess.Popen([sys.executable, "-c", script], **quiet)
    try:
        options = {"key": "key", "secret": "secret", "endpoint_url": f"http://127.0.0.1:{port}"}
        fs = s3fs.S3FileSystem(**options)
        for _ in range(100):
            try:
                fs.mkdir("campaigns")
                break
            except Exception:
                time.sleep(0.2)
        inputs = [path for path in part.path.parent.rglob("*") if path.is_file()]
        size = sum(path.stat().st_size for path in inputs)
        started = time.perf_counter()
        fs.put(f"{part.path.parent}/", "campaigns/beets/", recursive=True)
        upload = time.perf_counter() - started
        started = time.perf_counter()
        fs.get("campaigns/beets/", f"{folder / 'copy'}/", recursive=True)
        download = time.perf_counter() - started
        print(
            f"S3 of moto alone: {size / 1e6:.0f} MB up at {size / 1e6 / upload:.0f} MB/s, down at "
            f"{size / 1e6 / download:.0f} MB/s"
        )
        started = time.perf_counter()
        shutil.copytree(part.path.parent, folder / "again")
        print(f"local disk: copied at {size / 1e6 / (time.perf_counter() - started):.0f} MB/s")
        url = "s3://campaigns/beets/campaign.toml"
        for where in ("local", "s3"):
            more = {"path": url, "storage_options": options} if where == "s3" else {}
            out = "s3://campaigns/out" if where == "s3" else folder / "local"
            found, seconds = on_dask(part, out, 2, **more)
            print(f"Dask, 2 workers, {where:5}  {seconds:7.1f} s  {told(found)}  {load()}", flush=True)
        fs.get("campaigns/out/", f"{folder / 'fetched'}/", recursive=True)
        assert contents(folder / "fetched") == contents(folder / "local")
        made = sum(path.stat().st_size for path in (folder / "local").rglob("*") if path.is_file())
        print(f"  {size / 1e6:.0f} MB of inputs, {made / 1e6:.0f} MB of results, the same bytes")
    finally:
        served.terminate()
        served.wait()


def _nothing(item: dict[str, Any], needs: list[Any], place: Any) -> dict[str, Any]:
    return {"title": item["name"], "failure": None}


def tasks(count: int) -> None:
    with cluster(2) as processes, Client(processes) as client:
        items = [{"name": f"drive_P{k}", "project": "x" * 1500} for k in range(count // 2)]
        started, used = time.perf_counter(), time.process_time()
        first = client.map(_nothing, items, [[]] * len(items), place=1, pure=False)
        needs = [[first[k - 1], first[k]] for k in range(len(items))]
        second = client.map(_nothing, items, needs, place=1, pure=False)
        for _ in as_completed(first + second):
            pass
        wall, used = time.perf_counter() - started, time.process_time() - used
        print(
            f"{count} tasks that do nothing: {1e3 * wall / count:.2f} ms each, {1e3 * used / count:.2f} ms CPU of "
            f"scheduler and client  {load()}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plots", type=int, default=10)
    parser.add_argument("--dates", type=int, default=10)
    parser.add_argument("--only", default="bytes,restart,scaling,s3,tasks")
    parser.add_argument("--call", nargs=2, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if asked.call:
        path, out = map(Path, asked.call)
        on_dask(Campaign(path), out, 2)
        return
    only = asked.only.split(",")
    with tempfile.TemporaryDirectory(prefix="campaign-") as name:
        folder = Path(name)
        if {"bytes", "restart"} & set(only):
            last = f"P{asked.plots:02}"
            made = make(folder / "beets", asked.plots, asked.dates, many=last)
            truncate(made.drive("P01", made.dates[len(made.dates) // 2]) / "left.bin")
            bytes_and_a_killed_worker(made, folder)
            if "restart" in only:
                restarted(made, folder)
        if {"scaling", "s3"} & set(only):
            part = make(folder / "part", 4, 5)
            if "scaling" in only:
                scaling(part, folder)
            if "s3" in only:
                on_s3(part, folder)
        if "tasks" in only:
            tasks(20_000)


if __name__ == "__main__":
    main()
