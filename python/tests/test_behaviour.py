"""How functions behave: Ctrl-C, threads, progress, errors, arrays that are not copied."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import boresight


@pytest.fixture(scope="module")
def many() -> np.ndarray:
    """Points whose features take seconds."""
    return np.random.default_rng(1).random((2_000_000, 3)) * [10.0, 10.0, 0.02]


def test_ctrl_c_stops_the_work(many):
    # What it would take: a hundredth of the points, a hundredth of the time.
    started = time.perf_counter()
    boresight.features(many[::100], neighbours=400, progress=None)
    whole = 100 * (time.perf_counter() - started)
    timer = threading.Timer(0.5, signal.raise_signal, [signal.SIGINT])
    started = time.perf_counter()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        boresight.features(many, neighbours=400, progress=None)
    taken = time.perf_counter() - started
    timer.join()
    assert taken >= 0.5
    assert taken < 0.5 * whole, f"stopped after {taken:.2f} s of {whole:.2f} s"


def test_other_threads_run_meanwhile(many):
    counted, is_done = [0], threading.Event()

    def count():
        while not is_done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    started = time.perf_counter()
    boresight.features(many, neighbours=30, progress=None, threads=1)
    taken = time.perf_counter() - started
    is_done.set()
    thread.join()
    # Held, the interpreter would let it count once or twice.
    assert counted[0] > 100 * taken, f"{counted[0]} in {taken:.2f} s"


def test_from_a_thread_and_after_a_fork():
    points = np.random.default_rng(2).random((5_000, 3))
    expected = boresight.thin(points, 0.1, progress=None)
    found = []
    thread = threading.Thread(target=lambda: found.append(boresight.thin(points, 0.1, progress=None)))
    thread.start()
    thread.join()
    assert np.array_equal(found[0], expected)
    import multiprocessing

    with multiprocessing.get_context("fork").Pool(2) as pool:
        again = pool.starmap(boresight.thin, [(points, 0.1)] * 4)
    assert all(np.array_equal(one, expected) for one in again)


def test_progress_is_told_and_grows(many):
    calls = []
    boresight.features(many[:300_000], progress=lambda *call: calls.append(call))
    assert {call[0] for call in calls} == {"features"}
    done = [call[1] for call in calls]
    assert done[0] == 0 and done[-1] == calls[-1][2] == 300_000
    assert done == sorted(done) and len(done) >= 3


def test_an_exception_of_the_function_cancels(many):
    class Enough(Exception):
        pass

    def stop(stage, done, total):
        if done > 0:
            raise Enough(stage)

    with pytest.raises(Enough, match="features"):
        boresight.features(many, progress=stop)


def test_bars_are_those_of_tqdm(many, capsys, monkeypatch):
    boresight.features(many[:1000])
    assert capsys.readouterr().err == "", "short work has no bar"
    # Without the delay every bar is drawn, however fast the machine is.
    monkeypatch.setattr("boresight._progress._DELAY_S", 0.0)
    boresight.features(many[:300_000])
    told = capsys.readouterr()
    assert "features" in told.err and told.out == ""
    boresight.features(many[:1000], progress=None)
    assert capsys.readouterr().err == ""
    with pytest.raises(ValueError, match="expected a function"):
        boresight.thin(many[:10], 0.1, progress="dots")


def test_threads_do_not_change_results(many):
    part = many[:100_000]
    one, three = (boresight.features(part, progress=None, threads=n) for n in (1, 3))
    assert one.tobytes() == three.tobytes()


def test_arrays_are_not_copied(many):
    """The memory that features take beside the array is their own: words, index and neighbourhoods."""
    code = (
        "import numpy as np, boresight, resource\n"
        "p = np.zeros((6_000_000, 3))\n"
        "p[:, 0] = np.arange(len(p)) * 10.0\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "kept = boresight.thin(p, 1e6, progress=None)\n"
        "print(len(kept), (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    kept, more_mb = done.stdout.split()
    assert int(kept) == 60
    assert float(more_mb) < 100.0, f"{more_mb} MB for an array of 144 MB"
    view = boresight.features(many[:1000], progress=None)
    assert view.base is not None


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda p: boresight.features(p[:, :2]), ValueError, r"\(100, 2\), expected \(n, 3\)"),
        (lambda p: boresight.features(p, features=["flatness"]), ValueError, "no feature 'flatness'"),
        (lambda p: boresight.features(p, neighbours=0), ValueError, "above zero"),
        (lambda p: boresight.features(p, neighbours=5, radius_m=1.0), ValueError, "exclude"),
        (lambda p: boresight.thin(p, -1.0), ValueError, "above zero"),
        (
            lambda p: boresight.thin(np.where(p == p[7], np.nan, p), 0.1),
            boresight.InvalidError,
            "points of the cloud are not finite, the first at index 7",
        ),
        (
            lambda p: boresight.m3c2(p, np.where(p == p[7], np.nan, p)),
            boresight.InvalidError,
            "points of the second epoch are not finite",
        ),
        (lambda p: boresight.Mounting([0, 0, 0, 1], [0, np.nan, 0]), ValueError, "not finite"),
        (lambda p: boresight.campaign("campaign.toml", memory_mb=5), ValueError, "5 MB for an item with"),
        (lambda p: boresight.m3c2(p, p, cyl_radius=0.0), ValueError, "cyl_radius is 0.0"),
        (lambda p: boresight.m3c2(p, p[:0]), boresight.TooFewError, "no points"),
        (lambda p: boresight.m3c2(p, p, p, corepoint_normals=p[:5]), ValueError, "5 normals"),
        (lambda p: boresight.read("/nowhere/a.laz"), FileNotFoundError, "a.laz"),
        (lambda p: boresight.write("/nowhere-at-all/a.laz", p), FileNotFoundError, "nowhere-at-all"),
        (lambda p: boresight.read(__file__), boresight.FormatError, "test_behaviour.py, line 1"),
        (lambda p: boresight.smooth(), ValueError, "imu is needed"),
        (lambda p: boresight.run("/nowhere/project.toml"), FileNotFoundError, "project.toml"),
        (lambda p: boresight.Mounting(np.eye(3) * 2, [0, 0, 0]), ValueError, "not a rotation"),
        (lambda p: boresight.Mounting([0, 0, 0, 2], [0, 0, 0]), ValueError, "length 2"),
        (lambda p: boresight.georeference(p, np.arange(99.0), {}, None), ValueError, r"\(99,\), expected \(100,\)"),
    ],
)
def test_errors(call, error, text):
    with pytest.raises(error, match=text):
        call(np.random.default_rng(3).random((100, 3)))


def test_errors_know_their_place(tmp_path):
    path = tmp_path / "imu.csv"
    boresight.write(path, np.zeros(3, boresight.IMU))
    lines = path.read_text().splitlines()
    lines[2] = lines[2].replace("0", "zero", 1)
    path.write_text("\n".join(lines))
    with pytest.raises(boresight.FormatError) as raised:
        boresight.read(path)
    assert (raised.value.path, raised.value.line, raised.value.byte) == (str(path), 3, None)
    assert "zero" in raised.value.found and isinstance(raised.value, boresight.Error)
    with pytest.raises(boresight.DataError) as raised:
        boresight.m3c2(np.zeros((0, 3)), np.zeros((1, 3)))
    assert raised.value.remedy


def test_clouds_without_a_distance_are_warned_of():
    points = np.random.default_rng(1).random((100, 3))
    with pytest.warns(boresight.BoresightWarning, match="the clouds do not overlap: none of"):
        found = boresight.m3c2(points, points + [50.0, 0.0, 0.0], normal_radii=[0.5], progress=None)
    assert np.isnan(found.distances).all()
    assert found.to_dict() == {"core_points": len(found.distances), "n": 0}


def test_few_points_are_warned_of():
    with pytest.warns(boresight.BoresightWarning, match="10 points"):
        boresight.features(np.random.default_rng(1).random((10, 3)), progress=None)


def test_mountings_take_rotations_in_every_form():
    for seed in range(20):
        turn = Rotation.random(random_state=seed)
        forms = [boresight.Mounting(form, [1, 2, 3]) for form in (turn, turn.as_quat(), turn.as_matrix())]
        for mounting in forms:
            assert np.allclose(mounting.matrix[:3, :3], turn.as_matrix(), atol=1e-14)
            assert (mounting.rotation * turn.inv()).magnitude() < 1e-14
        assert forms[0].to_dict()["translation_m"] == [1, 2, 3]
    assert "1.00000 m" in forms[0]._repr_html_()


def test_points_are_placed_by_the_equation():
    rng = np.random.default_rng(5)
    turns = Rotation.from_rotvec(0.1 * rng.normal(size=(50, 3)))
    poses = {"time_s": np.arange(50.0), "position_m": rng.normal(size=(50, 3)), "quaternion_xyzw": turns.as_quat()}
    mounting = boresight.Mounting(Rotation.from_euler("xyz", [10, 20, 30], degrees=True), [1.0, 0.2, -0.3])
    points, at = rng.normal(size=(48, 3)), np.arange(1, 49)
    placed = boresight.georeference(points, at - 0.25, poses, mounting, time_offset_s=0.25, progress=None)
    expected = poses["position_m"][at] + turns[at].apply(mounting.translation_m + mounting.rotation.apply(points))
    assert np.allclose(placed, expected, rtol=0, atol=1e-14)
    outside = boresight.georeference(points, at + 10.0, poses, mounting, progress=None)
    assert np.isnan(outside[-9:]).all() and np.isfinite(outside[:38]).all()
    with pytest.raises(boresight.NoOverlapError, match="the gap is"):
        boresight.georeference(points, at + 100.0, poses, mounting, progress=None)


def test_arrays_of_every_kind(tmp_path):
    points = np.random.default_rng(4).random((2_000, 3))
    expected = boresight.features(points, progress=None)
    np.save(tmp_path / "points.npy", points)
    mapped = np.load(tmp_path / "points.npy", mmap_mode="r")
    for same in (np.asfortranarray(points), points[::-1][::-1], mapped, points.astype(">f8"), points.tolist()):
        assert boresight.features(same, progress=None).tobytes() == expected.tobytes()
    with pytest.warns(boresight.BoresightWarning):
        assert len(boresight.features(np.zeros((0, 3)), progress=None)) == 0
    assert len(boresight.thin(np.zeros((0, 3)), 0.1, progress=None)) == 0
    lost = points.copy()
    lost[5] = np.nan
    assert np.isnan(boresight.features(lost, progress=None)["planarity"]).sum() == 1


def test_errors_and_results_travel_between_processes(tmp_path):
    import pickle

    (tmp_path / "a.csv").write_text("what is this\n")
    with pytest.raises(boresight.FormatError) as raised:
        boresight.read(tmp_path / "a.csv")
    copy = pickle.loads(pickle.dumps(raised.value))
    assert (str(copy), copy.path, copy.line) == (str(raised.value), raised.value.path, raised.value.line)
    mounting = boresight.Mounting(np.eye(3), [1, 2, 3])
    assert pickle.loads(pickle.dumps(mounting)).to_dict() == mounting.to_dict()
    cloud = boresight.Cloud(np.zeros((2, 3)), {"time_s": [1.0, 2.0]})
    assert pickle.loads(pickle.dumps(cloud)).to_dict() == cloud.to_dict()
