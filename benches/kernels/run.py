#!/usr/bin/env python3
"""Compares boresight's kernels with their peers on the same files.

usage: python3 benches/kernels/run.py [--quick] [--crates] ...

Creates a virtual environment with the peers, builds boresight, makes the clouds (see clouds.py), runs
boresight and every peer in turn, each run in a new process, so that noise of the machine affects all
alike, prints tables of medians and ratios, and writes them into docs/performance.md between its two
markers. Then checks that the numbers agree (see agreement.py); exit code 1 if they do not.

Times of peers: from arrays in memory to results in memory, including search structures (see
with_peer.py). Times of boresight: the stages between reading and writing in its --json output. Times of
whole processes, with reading, writing, and for the peers the start of Python, are in a separate table.
"""

import argparse
import datetime
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from itertools import product
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import tables
from common import ROOT, build, environment, measured, say, write

PACKAGES = ["open3d==0.20.0", "small_gicp==1.0.1", "jakteristics==0.6.2", "pgeof==0.3.4", "py4dgeo==1.2.0",
            "scipy==1.17.1", "numpy==2.4.6", "laspy[lazrs]==2.7.0"]
ORDERS, THREADS = ("shuffled", "ordered"), (1, 2)
NEIGHBOURS, VOXEL_M = 50, 0.005
CYLINDER_RADIUS_M, MAX_DISTANCE_M, NORMAL_RADII_M = 0.02, 0.05, (0.03, 0.06)
PEERS = {
    "features": ("open3d", "small_gicp", "jakteristics", "pgeof"),
    "thin": ("small_gicp", "open3d", "open3d.t"),
    "m3c2": ("py4dgeo k-d tree", "py4dgeo octree"),
}


@dataclass(frozen=True)
class Case:
    """One kernel on clouds of one size."""

    kernel: str
    points: int
    goal: float  # wanted factor by which boresight is faster than the best peer
    core: int = 0

    def described(self):
        """Its description in the tables; throughput counts points, for M3C2 core points."""
        return {"title": self.title, "kernel": self.kernel, "points": self.points, "goal": self.goal,
                "units": self.core or self.points}

    @property
    def title(self):
        n = f"{self.points / 1e6:g} million points"
        return {
            "features": f"Structure tensor and omnivariance, k = {NEIGHBOURS}, {n}",
            "thin": f"Voxel thinning, {n} at {VOXEL_M * 1e3:g} mm",
            "m3c2": f"M3C2, {n} a cloud, {self.core:,} core points, cylinder radius {CYLINDER_RADIUS_M} m, maximum "
                    f"distance {MAX_DISTANCE_M} m, normals at " + " and ".join(f"{r} m" for r in NORMAL_RADII_M),
        }[self.kernel]


FULL = [Case("features", 1_000_000, 5.0), Case("features", 5_000_000, 5.0), Case("thin", 20_000_000, 2.0),
        Case("m3c2", 5_000_000, 10.0, 500_000)]
QUICK = [Case("features", 100_000, 5.0), Case("thin", 1_000_000, 2.0), Case("m3c2", 200_000, 10.0, 20_000)]


def main():
    given = arguments()
    python = environment(given.venv, PACKAGES)
    binary = None if given.peers_only else str((given.boresight or Path(build())).resolve())
    saved = given.work / ("quick.json" if given.quick else "full.json")
    sections = json.loads(saved.read_text()) if saved.exists() and not given.peers_only else {}
    for kernel in given.only.split(","):
        cases = [case for case in (QUICK if given.quick else FULL) if case.kernel == kernel]
        sections[kernel] = measure(python, binary, kernel, cases, given)
        if binary:
            saved.write_text(json.dumps(sections))
    if not binary:
        print(tables.peers(sections))
        return 0
    text = tables.report(sections, binary)
    print(text)
    if not given.no_write:
        write("Kernels", "benches/kernels", text)
    return 0 if all(section["holds"] for section in sections.values()) else 1


def measure(python, binary, kernel, cases, given):
    """The section of the page on a kernel."""
    clouds = [files(python, case, given.work) for case in cases]
    section = {"cases": [{**case.described(), "runs": rounds(python, binary, case, made, given)}
                         for case, made in zip(cases, clouds)]}
    if given.crates and kernel == "features":
        # One size is enough; searching point by point takes minutes for a million points.
        section["indices"] = crates(cases[0], clouds[0], given)
    if binary:
        say(f"agreement: {kernel}")
        largest = clouds[-1]["files"]["shuffled"].values()
        command = [python, HERE / "agreement.py", binary, given.work / "agreement", kernel, *largest]
        process = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, text=True, cwd=given.work)
        lines = process.stdout.splitlines()
        if process.returncode != 0 and not any(line.startswith("FAILED") for line in lines):
            lines.append(f"FAILED: the checks of {kernel} ended early")
        section.update(agreed=lines, holds=process.returncode == 0)
    section["measured"] = (f"{given.repetitions} rounds, {datetime.date.today()}, "
                           f"load {os.getloadavg()[0]:.1f} at the end")
    return section


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small clouds, one round, nothing written: a minute")
    parser.add_argument("--only", default="features,thin,m3c2", metavar="KERNEL,...",
                        help="measure these; the page keeps the last results of the others")
    parser.add_argument("--repetitions", type=int, default=3, metavar="N", help="rounds of all programs [3]")
    parser.add_argument("--boresight", type=Path, metavar="FILE", help="a binary to run instead of building one")
    parser.add_argument("--peers-only", action="store_true", help="without boresight; nothing written")
    parser.add_argument("--crates", action="store_true", help="neighbour indices of Rust crates too (see crates/)")
    parser.add_argument("--venv", type=Path, default=ROOT / "target" / "bench-venv", metavar="DIR")
    parser.add_argument("--work", type=Path, default=ROOT / "target" / "bench-kernels", metavar="DIR",
                        help="the clouds, 3 GB; made if missing")
    parser.add_argument("--no-write", action="store_true", help="only print")
    given = parser.parse_args()
    if given.quick:
        given.repetitions, given.no_write = 1, True
    # Peers run in the folder of the clouds: py4dgeo writes a log into its working directory.
    given.work, given.venv = given.work.resolve(), given.venv.absolute()
    given.work.mkdir(parents=True, exist_ok=True)
    return given


def files(python, case, work):
    """The clouds of a case: {"files": {order: {cloud: path}}, "radius_m": ...}."""
    say(f"clouds: {case.title}")
    command = [python, str(HERE / "clouds.py"), str(work), case.kernel, str(case.points), "--core", str(case.core)]
    made = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    for order in made["files"].values():
        order.update({name: work / file for name, file in order.items()})
    return made


def rounds(python, binary, case, clouds, given):
    """The runs of all programs, in turn within a round."""
    found = []
    for n, order, threads in product(range(given.repetitions), ORDERS, THREADS):
        say(f"{case.title}: {order}, {threads} threads, {n + 1}/{given.repetitions}")
        paths = clouds["files"][order]
        for name in (("boresight",) if binary else ()) + PEERS[case.kernel]:
            if name == "boresight":
                run = boresight(binary, case.kernel, paths, threads, given.work / f"out-{case.kernel}")
            else:
                run = peer(python, name, case.kernel, paths, threads, clouds.get("radius_m"))
            if run:
                found.append({"order": order, "threads": threads, "program": name, **run})
    return found


def boresight_command(binary, kernel, paths, out):
    """The command line of one kernel, results into `out`."""
    commands = {
        "features": lambda: ["features", paths["cloud"], "--neighbours", NEIGHBOURS, "--features", "omnivariance"],
        "thin": lambda: ["thin", paths["cloud"], "--voxel-m", VOXEL_M],
        # The compared cloud comes first, then its reference, whose normals are used.
        "m3c2": lambda: ["compare", paths["epoch2"], paths["epoch1"], "--core", paths["core"],
                         "--cylinder-radius-m", CYLINDER_RADIUS_M, "--max-distance-m", MAX_DISTANCE_M,
                         "--normal-radii-m", ",".join(map(str, NORMAL_RADII_M))],
    }
    return [binary, *map(str, commands[kernel]()), "--out", str(out), "--json", "--quiet"]


def boresight(binary, kernel, paths, threads, out):
    run = measured([*boresight_command(binary, kernel, paths, out), "--threads", str(threads)])
    if run is None:
        return None
    result = json.loads(run.pop("out"))
    stages = {name: stage["seconds"] for name, stage in result["stages"].items()}
    parts = {name: seconds for name, seconds in stages.items() if name not in ("read", "write")}
    run.update(seconds=sum(parts.values()), parts=parts, process_cpu_s=run.pop("cpu_s"))
    if kernel == "thin":
        run["sha256"] = tables.digest(next(out.glob(f"{paths['cloud'].stem}-thin*")))
    return run


def peer(python, name, kernel, paths, threads, radius_m):
    """One run of a peer, whose numpy uses one thread: more would not help here."""
    command = [python, str(HERE / "with_peer.py"), name, kernel, str(threads), *map(str, paths.values())]
    if radius_m:
        command += ["--radius", str(radius_m)]
    settings = {**os.environ, "OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": "1"}
    run = measured(command, env=settings, stderr=subprocess.DEVNULL, cwd=next(iter(paths.values())).parent)
    if run is None:
        return None
    process_cpu_s = run.pop("cpu_s")
    return {**run, **json.loads(run.pop("out").splitlines()[-1]), "process_cpu_s": process_cpu_s}


def crates(case, clouds, given):
    """Times of the neighbour indices of crates/ on the clouds of the features."""
    manifest = str(HERE / "crates" / "Cargo.toml")
    target = given.work / "crates"
    command = ["cargo", "build", "--release", "--quiet", "--manifest-path", manifest, "--target-dir", str(target)]
    subprocess.run(command, check=True)
    binary = target / "release" / "neighbour-indices"
    found = []
    for n, order, threads in product(range(given.repetitions), ORDERS, THREADS):
        say(f"crates: {case.points} points {order}, {threads} threads, {n + 1}/{given.repetitions}")
        run = measured([str(binary), str(clouds["files"][order]["cloud"]), str(threads), str(NEIGHBOURS)])
        if run:
            found += [{"points": case.points, "order": order, "threads": threads, **line}
                      for line in map(json.loads, run["out"].splitlines())]
    return found


if __name__ == "__main__":
    sys.exit(main())
