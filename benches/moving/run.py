#!/usr/bin/env python3
"""Compares boresight with KinScanCal on the same drives, with rigid and with moving mountings.

usage: python3 benches/moving/run.py [--rows rigid,walk] [--peer FOLDER] [--work DIR] ...

Simulates a drive for each row, estimates its poses with `boresight trajectory` (the first of two
steps), runs the peer with these poses and the true mountings of the robot at rest, compares the points
and the gap between the scanners with the truth (see evaluate.py), and prints a table. "Two steps" means
the same poses with the same mountings, unchanged: the input of the peer. The time of the joint adjustment
is that of the whole example `joint`, with simulation, trajectory and its own comparison; the time of the
peer begins when the poses are ready. All run on one thread.

The peer is cloned, unless --peer names a checkout. It computes a normal from the neighbours within 1 cm,
at least ten. The simulator's default of 320 points per profile and 25 profiles per second has too few of
them where the robot drives faster than over boards; a real scanner has many more.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from common import ROOT, build, environment, measured, row, say, version

PACKAGES = ["numpy==2.4.6", "scipy==1.17.1", "scikit-learn==1.9.1", "pandas==3.1.1", "matplotlib==3.11.2",
            "laspy==2.7.0", "alive_progress", "colorama", "plyfile", "rich"]
# If so many windows fail in a row that the peer's spline has no solution, the peer is run again with fewer
# windows: there is a knot every six windows.
WIDE_STEP_M = 0.2
PEER, COMMIT = "https://github.com/Engineering-Geodesy-Bonn/KinScanCal", "c6146d5"

# The drive of `simulate --scenario plain`, and the first passes of `demo`: on the whole drive of `demo`
# the peer takes most of an hour, because windows fail.
BACK_AND_FORTH = [{"from_m": [(1.25, 6.25)[k % 2], 1.5 + 0.6 * k], "to_m": [(6.25, 1.25)[k % 2], 1.5 + 0.6 * k]}
                  for k in range(6)]
OVER_BOARDS = [{"board": board, "heading_deg": heading} for heading, boards in [(90.0, (0, 1)), (270.0, (4, 3))]
               for board in boards]
DENSE = {"profiles": {"width": 640, "rate_hz": 50.0}}
SOIL = {**DENSE, "soil": {"clod_height_m": 0.02, "clod_cover": 0.1}, "boards": [],
        "drives": [{"passes": BACK_AND_FORTH}]}
BENDS = {"enabled": True, "rotation_deg_per_deg": 0.0, "shift_m_per_deg": 0.0, "shift_m_per_m_s2": 0.0,
         "drift_deg": 0.0, "drift_m": 0.0}
ROWS = {
    "rigid": ("clods, rigid", SOIL),
    "walk": ("clods, Gauss-Markov process", {**SOIL, "deformation": {**BENDS, "walk_m": 0.0015, "walk_deg": 0.08}}),
    "compliance": ("clods, bends with roll and pitch", {
        **SOIL, "deformation": {**BENDS, "rotation_deg_per_deg": 0.15, "shift_m_per_deg": 0.006}}),
    "boards": ("clods and boards, rigid", {**DENSE, "soil": {"clod_height_m": 0.02, "clod_cover": 0.2},
                                           "drives": [{"passes": OVER_BOARDS}]}),
}

ERRORS = ("points_mm", "gap_normal_mm", "gap_3d_mm")


def main():
    given = arguments()
    programs = given.binary or build(), given.joint or build_joint()
    python = environment(given.venv, PACKAGES)
    peer = given.peer or checkout(given.work / "KinScanCal")
    at = version("git", "-C", str(peer), "rev-parse", "--short", "HEAD")
    print(row("drive", "method", "points mm", "gap mm", "gap mm, 3-D", "s", "CPU s", "windows failed"))
    print(row("---", "---", *["---:"] * 6))
    for name in given.rows:
        title, scenario = ROWS[name]
        scenario = {"seed": given.seed, **scenario}
        for method, found in compare(programs, python, peer, given.work / name, scenario).items():
            numbers = [f"{found[key]:.2f}" if key in found else "–" for key in ERRORS]
            times = [f"{found[key]:.0f}" for key in ("seconds", "cpu_s")]
            failed = f"{found['failed']} of {found['windows']}" if "windows" in found else ""
            print(row(title, method, *numbers, *times, failed), flush=True)
    print(f"\nRoot mean squares against the truth; seed {given.seed}; KinScanCal {at}.")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rows", default=",".join(ROWS), metavar="ROW,ROW", help=f"[{','.join(ROWS)}]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--binary", metavar="FILE", help="boresight; built if not given")
    parser.add_argument("--joint", metavar="FILE", help="the example of this name; built if not given")
    parser.add_argument("--peer", type=Path, metavar="DIR", help="checkout of KinScanCal; cloned if not given")
    parser.add_argument("--venv", type=Path, default=ROOT / "target" / "bench-moving-venv", metavar="DIR")
    parser.add_argument("--work", type=Path, default=ROOT / "target" / "bench-moving", metavar="DIR")
    given = parser.parse_args()
    given.rows = given.rows.split(",")
    unknown = set(given.rows) - set(ROWS)
    if unknown:
        parser.error(f"no row {', '.join(unknown)}")
    return given


def build_joint():
    subprocess.run(["cargo", "build", "--release", "--quiet", "--features", "examples", "--example", "joint"], cwd=ROOT, check=True)
    return str(ROOT / "target" / "release" / "examples" / "joint")


def checkout(folder):
    if not folder.exists():
        subprocess.run(["git", "clone", "--quiet", PEER, str(folder)], check=True)
        subprocess.run(["git", "-C", str(folder), "checkout", "--quiet", COMMIT], check=True)
    return folder


def toml(value):
    """A value as inline TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(of)}" for key, of in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def compare(programs, python, peer, work, scenario):
    """Errors of each method on one drive, with its run time in seconds."""
    binary, joint = programs
    work.mkdir(parents=True, exist_ok=True)
    file, drive = work / "scenario.toml", work / "simulated" / "drive-1"
    file.write_text("".join(f"{key} = {toml(value)}\n" for key, value in scenario.items()))
    say(f"{work.name}: simulating")
    succeed([binary, "simulate", "--scenario", str(file), "--out", str(drive.parent), "--quiet"])
    say(f"{work.name}: two steps")
    poses, rest = work / "trajectory" / "trajectory.csv", drive / "truth" / "mounting.toml"
    run = succeed([binary, "trajectory", str(drive / "project.toml"), "--out", str(poses.parent), "--quiet"])
    methods = {"two steps": (poses, rest, {"seconds": run["wall_s"], "cpu_s": run["cpu_s"]})}
    methods["KinScanCal"] = with_peer(python, peer, drive, poses, rest, work / "peer")
    if not methods["KinScanCal"][1]:
        methods[f"KinScanCal, a window every {WIDE_STEP_M} m"] = with_peer(
            python, peer, drive, poses, rest, work / "peer-wide", "--step-m", str(WIDE_STEP_M))
    say(f"{work.name}: joint adjustment")
    kept = work / "joint"
    run = succeed([joint, "1", str(scenario["seed"]), "--case", "known", "--scenario", str(file), "--keep", str(kept)])
    methods["joint adjustment"] = (kept / "trajectory.csv", kept / "mounting.csv",
                                   {"seconds": run["wall_s"], "cpu_s": run["cpu_s"]})
    return {method: {**errors(python, drive, poses, mountings), **more}
            for method, (poses, mountings, more) in methods.items()}


def with_peer(python, peer, drive, poses, rest, work, *more):
    say(f"{work.parent.name}: {' '.join(['KinScanCal', *more])}")
    run = succeed([python, str(HERE / "with_peer.py"), str(peer), str(drive), "--trajectory", str(poses),
                   "--mountings", str(rest), "--work", str(work), *more])
    found = json.loads(run["out"])
    return poses, work / "mounting.csv" if found["solved"] else None, found


def errors(python, drive, poses, mountings):
    if mountings is None:
        return {}
    run = succeed([python, str(HERE / "evaluate.py"), str(drive), "--trajectory", str(poses),
                   "--mountings", str(mountings)])
    return json.loads(run["out"])


def succeed(command):
    run = measured(command, env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"})
    if run is None:
        sys.exit(1)
    return run


if __name__ == "__main__":
    main()
