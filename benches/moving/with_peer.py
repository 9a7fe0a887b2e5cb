"""Runs KinScanCal on one drive, writes its mountings by time, and prints one JSON line.

usage: with_peer.py PEER_FOLDER DRIVE --trajectory CSV --mountings FILE --work DIR [--step-m M]

PEER_FOLDER is a checkout of KinScanCal, which is run unchanged, with its own settings; only its global
offset is set to zero, for worlds with a local origin. Its main.py is not used, because it copies results into
a data set's folders and plots them with a library that is not among its requirements; this script calls the
same stages as main.py. DIR receives its input (input, calibration), its output (output), its log, and
mounting.csv.

Two problems that have nothing to do with the comparison would end the peer. First, windows are equally spaced
along the path but knots of its spline in time: while the robot rests, knots have no windows. Therefore
recordings are cut to the time of motion; the mountings are constant before and after. Second, its ICP raises
an error if no neighbours match: such a window counts as failed, like the windows that it rejects itself. If
so many fail in a row that a knot has none left, its spline is singular, and "solved" is false.
"""

import argparse
import json
import sys
import time
from contextlib import chdir, redirect_stdout
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

from evaluate import mountings, profiles, trajectory

SCANNERS = {"left": "l", "right": "r"}
MOVING_M_S = 0.05


def moving(poses):
    """The first and the last time at which the robot is faster than a crawl."""
    speed = np.linalg.norm(np.gradient(poses.position_m, poses.time_s, axis=0), axis=1)
    return poses.time_s[speed > MOVING_M_S][[0, -1]]


def write_recording(recording, span_s, path):
    """Writes a processed recording: for every profile its time, count, x, y, z (mm) and intensities."""
    with open(path, "wb") as out:
        for time_s, x, z in zip(*profiles(recording)):
            if not span_s[0] < time_s < span_s[1]:
                continue
            seen = np.isfinite(x)
            n = int(seen.sum())
            xyz = np.stack([x[seen], np.zeros(n), z[seen]]) * 1e3
            out.write(time_s.tobytes() + np.uint32(n).tobytes() + xyz.astype("<f4").tobytes())
            out.write(np.zeros(n, "<u4").tobytes())


def write_poses(poses, path):
    """Ten columns: time, position, velocity, and roll, pitch, yaw (rad) of Rz Ry Rx."""
    rows = np.column_stack([poses.time_s, poses.position_m, np.zeros_like(poses.position_m),
                            poses.rotation.as_euler("xyz")])
    np.savetxt(path, rows, fmt="%.12f")


def write_mounting(mounting, path):
    angles = mounting.rotation.inv().as_euler("xyz", degrees=True)[0]
    values = zip(("x", "y", "z", "rx", "ry", "rz"), (*mounting.position_m[0], *angles))
    keys = "".join(f"<{key}>{value:.12f}</{key}>" for key, value in values)
    path.write_text(f'<SystemCalibration FormatVersion="1">{keys}</SystemCalibration>\n')


def prepare(given):
    for name in ("input", "output", "calibration"):
        (given.work / name).mkdir(parents=True, exist_ok=True)
    poses, mounts = trajectory(given.trajectory), mountings(given.mountings)
    for name, short in SCANNERS.items():
        write_recording(given.drive / f"{name}.bin", moving(poses), given.work / "input" / f"{short}.bin")
        write_poses(poses, given.work / "input" / f"{short}.trj")
        write_mounting(mounts[name], given.work / "calibration" / f"system_config_lmi_{short}.xml")
    settings = json.loads((given.peer / "config" / "kin_calibration_config.json").read_text())
    if given.step_m:
        settings["IntervalConfig"]["stepsize"] = given.step_m
    settings["GeorefConfig"]["globaloffset"] = {"x": 0, "y": 0, "z": 0}
    (given.work / "settings.json").write_text(json.dumps(settings))


def calibrate(work):
    """The stages of the peer's main.py, from reading to mountings at every profile, and whether they succeeded."""
    sys.modules["open3d"] = ModuleType("open3d")  # only used for drawing; large, and needs system libraries
    from src.core.KinematicCalibration import KinematicCalibration
    from src.icp.SymPlane2PlaneICP import SymPlane2PlaneICP

    run = SymPlane2PlaneICP.runICP

    def run_or_fail(icp, config):
        try:
            return run(icp, config)
        except (np.linalg.LinAlgError, IndexError, ValueError):
            icp.xyzm1 = []
            return np.full(6, np.nan), False

    SymPlane2PlaneICP.runICP = run_or_fail
    with chdir(work), open("log.txt", "w") as log, redirect_stdout(log):
        peer = KinematicCalibration(".", "output/", "calibration/", "settings.json")
        peer.loadconfig()
        peer.loadcalibration()
        peer.loaddata()
        peer.run()
        try:
            peer.compute_kinematic_calibration_parameter()
        except np.linalg.LinAlgError:
            return peer, False
    return peer, True


def write_mountings(peer, path):
    """Writes the peer's mounting splines, evaluated at the profiles, as mounting.csv."""
    with open(path, "w") as out:
        out.write("time_s,scanner,x_m,y_m,z_m,qx,qy,qz,qw\n")
        for name, found in (("left", peer.kcalL.xint), ("right", peer.kcalR.xint)):
            turns = Rotation.from_euler("xyz", found[:, 1:4]).inv().as_quat()
            for row, turn in zip(found, turns):
                out.write(f"{row[0]:.6f},{name}," + ",".join(f"{v:.12f}" for v in (*row[4:7], *turn)) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("peer", type=Path)
    parser.add_argument("drive", type=Path)
    for name in ("--trajectory", "--mountings", "--work"):
        parser.add_argument(name, type=Path, required=True)
    parser.add_argument("--step-m", type=float, help="distance between windows, instead of the peer's setting")
    given = parser.parse_args()
    prepare(given)
    sys.path.insert(0, str(given.peer.resolve()))
    begun, begun_cpu = time.perf_counter(), time.process_time()
    peer, solved = calibrate(given.work)
    seconds, cpu_s = time.perf_counter() - begun, time.process_time() - begun_cpu
    if solved:
        write_mountings(peer, given.work / "mounting.csv")
    windows = np.array([window["transformation"] for window in peer.xlist])
    print(json.dumps({"seconds": seconds, "cpu_s": cpu_s, "solved": solved, "windows": len(windows),
                      "failed": int(np.isnan(windows).any(axis=1).sum())}))


if __name__ == "__main__":
    main()
