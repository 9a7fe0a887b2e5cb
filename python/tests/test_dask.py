"""Campaigns on a Dask cluster of processes: the bytes of the pool, failures, killed workers, S3."""

from __future__ import annotations

import json
import os
import signal
import socket
import threading
from pathlib import Path

import pytest

import boresight
import simulated_campaign
from simulated_campaign import contents, truncate

distributed = pytest.importorskip("distributed")
pytest.importorskip("s3fs")
server = pytest.importorskip("moto.server")

import boresight.dask  # noqa: E402

# Enough for each item but the one with many profiles, MB.
MEMORY_MB = 260


@pytest.fixture(scope="module")
def client():
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two calibrations, six drives and three changes; one file is cut short and one item needs too much memory."""
    made = simulated_campaign.make(tmp_path_factory.mktemp("campaign") / "beets", plots=3, dates=2, many="P03")
    truncate(made.drive("P02", made.dates[1]) / "left.bin")
    return made


@pytest.fixture(scope="module")
def by_pool(made, tmp_path_factory):
    out = tmp_path_factory.mktemp("pool")
    return boresight.campaign(made.path, out, workers=2, memory_mb=MEMORY_MB, progress=None)


def check(found, by_pool):
    """Bytes of all results, and what is said of those that failed."""
    assert found.items == by_pool.items
    states = [item["state"] for item in found.items]
    assert (states.count("finished"), states.count("failed")) == (7, 4)
    said = {(item["kind"], item["plot"]): item["problem"] for item in found.failed}
    assert "left.bin" in said["drive", "P02"] and "out of memory" in said["drive", "P03"]
    assert said["change", "P02"].startswith("not tried, as it needs drive P02")
    assert "out of memory" in found._repr_html_()


@pytest.mark.long
def test_the_bytes_are_those_of_the_pool(client, made, by_pool, tmp_path):
    told = []
    found = boresight.dask.campaign(
        made.path, client, tmp_path, memory_mb=MEMORY_MB, progress=lambda *call: told.append(call)
    )
    check(found, by_pool)
    assert contents(tmp_path) == contents(Path(by_pool.out))
    assert told[-1] == ("items", 11, 11) and ("reading inputs", 0) in [call[:2] for call in told]
    page = Path(found.page).read_text()
    assert "left.bin" in page and "out of memory" in page
    # What is finished is not done again, and a mended file is another item.
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("items/*/work.json")}
    cut = made.drive("P02", made.dates[1]) / "left.bin"
    short = cut.read_bytes()
    cut.write_bytes((made.drive("P02", made.dates[0]) / "left.bin").read_bytes())
    mended = boresight.dask.campaign(made.path, client, tmp_path, memory_mb=MEMORY_MB, progress=None)
    cut.write_bytes(short)
    assert {(item["kind"], item["plot"]) for item in mended.failed} == {("drive", "P03"), ("change", "P03")}
    assert all(path.stat().st_mtime_ns == changed for path, changed in before.items())
    assert len(list(tmp_path.glob("items/*/work.json"))) == len(before) + 2


def test_a_killed_worker_costs_nothing(client, tmp_path):
    made = simulated_campaign.make(tmp_path / "beets", plots=1, dates=2)
    by_pool = boresight.campaign(made.path, tmp_path / "pool", workers=2, progress=None)
    out = tmp_path / "dask"
    killed, is_over = [], threading.Event()
    pids = client.run(os.getpid)

    def kill_one_that_works():
        while not killed and not is_over.wait(0.02):
            busy = [worker for worker, keys in client.processing().items() if keys]
            if busy and any(out.glob("items/*/result.json")):
                killed.append(busy[0])
                os.kill(pids[busy[0]], signal.SIGKILL)

    thread = threading.Thread(target=kill_one_that_works)
    thread.start()
    found = boresight.dask.campaign(made.path, client, out, progress=None)
    is_over.set()
    thread.join()
    assert killed
    assert found.items == by_pool.items and not found.failed
    assert contents(out) == contents(Path(by_pool.out))
    client.wait_for_workers(2)


@pytest.mark.long
def test_the_drift_watch_is_that_of_the_pool(client, tmp_path):
    made = simulated_campaign.make(tmp_path / "beets", plots=1, dates=2, boards=False, rate_hz=100.0, drift=True)
    by_pool = boresight.campaign(made.path, tmp_path / "pool", workers=2, progress=None)
    found = boresight.dask.campaign(made.path, client, tmp_path / "dask", progress=None)
    kinds = [(item["kind"], item["state"]) for item in found.items]
    assert kinds.count(("overlap", "finished")) == 2 and not found.failed
    assert found.items == by_pool.items
    assert contents(tmp_path / "dask") == contents(tmp_path / "pool")
    (right,) = found.to_dict()["drift"]["scanners"]
    assert (right["name"], len(right["days"]), right["alarms"]) == ("right", 2, [])


@pytest.fixture(scope="module")
def store():
    """An S3 on this machine."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    served = server.ThreadedMotoServer(ip_address="127.0.0.1", port=port, verbose=False)
    served.start()
    yield {"key": "key", "secret": "secret", "endpoint_url": f"http://127.0.0.1:{port}"}
    served.stop()


@pytest.mark.long
def test_inputs_and_outputs_in_s3(client, made, by_pool, store, tmp_path):
    import s3fs

    fs = s3fs.S3FileSystem(**store)
    fs.mkdir("campaigns")
    fs.put(f"{made.path.parent}/", "campaigns/beets/", recursive=True)
    url = "s3://campaigns/beets/campaign.toml"
    found = boresight.dask.campaign(url, client, storage_options=store, memory_mb=MEMORY_MB, progress=None)
    check(found, by_pool)
    assert found.page == "s3://campaigns/beets/out/campaign.html"
    fs.get("campaigns/beets/out/", f"{tmp_path}/", recursive=True)
    assert contents(tmp_path) == contents(Path(by_pool.out))
    # The index and what is known of the inputs are there: nothing is read or done again.
    kept = {path: fs.info(path)["LastModified"] for path in fs.glob("campaigns/beets/out/items/*/result.json")}
    asked = []
    again = boresight.dask.campaign(
        url, client, storage_options=store, memory_mb=MEMORY_MB, progress=lambda *call: asked.append(call[0])
    )
    fs.invalidate_cache()
    assert again.to_dict() == found.to_dict() and len(kept) == 7
    assert all(fs.info(path)["LastModified"] == changed for path, changed in kept.items())
    assert "reading inputs" not in asked
    assert json.loads(fs.cat_file("campaigns/beets/out/campaign.json")) == found.to_dict()
    with pytest.raises(FileNotFoundError, match="s3://campaigns/beans/campaign.toml"):
        boresight.dask.campaign("s3://campaigns/beans/campaign.toml", client, storage_options=store, progress=None)
