"""What Python costs: `boresight.features` against the command `boresight features` on the same points.

    python benches/overhead.py --command PATH [--points 5000000] [--rounds 5]

Two comparisons, in turn, medians and spans of all rounds:

stage   the command's own time of its stage "features" (index, neighbourhoods, features) against the call
whole   the process of the command (reads LAZ, writes LAZ with the features) against read, features and write in a
        process of Python, with its start and imports

CPU times are those of all threads; on a machine that does other work too they, and the fastest rounds, say more than
medians of wall times.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import boresight

WHOLE = """
import sys, boresight
cloud = boresight.read(sys.argv[1], progress=None)
found = boresight.features(cloud, progress=None, threads=int(sys.argv[3]))
cloud.attributes |= {name: found[name] for name in found.dtype.names}
boresight.write(sys.argv[2], cloud, progress=None)
"""


def cloud(points: int) -> np.ndarray:
    """Passes over an uneven field, in the order in which a scanner would see it, metres."""
    rng = np.random.default_rng(1)
    along = np.linspace(0.0, 60.0, points)
    across = rng.uniform(0.0, 1.5, points)
    heights = 0.05 * np.sin(3.0 * along) * np.cos(5.0 * across) + rng.normal(0.0, 0.002, points)
    return np.stack([along % 15.0, across + 1.5 * (along // 15.0), heights], axis=1)


def children_s() -> float:
    """CPU time of the processes that have ended, seconds."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def process(arguments: list[str]) -> tuple[float, float, str]:
    """Wall and CPU time of a process, seconds, and what it prints."""
    wall, cpu = time.perf_counter(), children_s()
    done = subprocess.run(arguments, capture_output=True, text=True, check=True)
    return time.perf_counter() - wall, children_s() - cpu, done.stdout


def told(name: str, values: list[float]) -> str:
    return f"{name} {statistics.median(values):7.3f} s ({min(values):.3f} to {max(values):.3f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--command", required=True)
    parser.add_argument("--points", type=int, default=5_000_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    asked = parser.parse_args()
    stage: dict[str, list[float]] = {"command": [], "python": [], "python, CPU": []}
    whole: dict[str, list[float]] = {"command": [], "python": [], "command, CPU": [], "python, CPU": []}
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder) / "cloud.laz", Path(folder) / "out"
        boresight.write(file, cloud(asked.points), progress=None)
        read = boresight.read(file, progress=None)
        for turn in range(asked.rounds):
            for who in ("command", "python")[:: 1 if turn % 2 == 0 else -1]:
                if who == "command":
                    arguments = [asked.command, "features", str(file), "--out", str(out), "--json", "--quiet"]
                    arguments += ["--threads", str(asked.threads)]
                    wall, cpu, printed = process(arguments)
                    stage["command"].append(json.loads(printed)["stages"]["features"]["seconds"])
                else:
                    wall, cpu, _ = process(
                        [sys.executable, "-c", WHOLE, str(file), str(out / "python.laz"), str(asked.threads)]
                    )
                    started, used = time.perf_counter(), time.process_time()
                    found = boresight.features(read, progress=None, threads=asked.threads)
                    stage["python"].append(time.perf_counter() - started)
                    stage["python, CPU"].append(time.process_time() - used)
                    del found
                whole[who].append(wall)
                whole[f"{who}, CPU"].append(cpu)
    print(
        f"{asked.points} points, {asked.rounds} rounds, {asked.threads} threads, load {os.getloadavg()[0]:.1f} at the end"
    )
    for name, times in (("stage", stage), ("whole", whole)):
        for who, values in times.items():
            print(f"  {name}  {told(f'{who:13}', values)}")
        pairs = [("", "command", "python"), (", CPU", "command, CPU", "python, CPU")]
        for what, theirs, ours in pairs:
            if theirs in times:
                ratios = [of(times[ours]) / of(times[theirs]) for of in (statistics.median, min)]
                median, fastest = (f"{100.0 * (ratio - 1.0):+.1f} %" for ratio in ratios)
                print(f"  {name}  overhead{what}: {median} of the medians, {fastest} of the fastest rounds")


if __name__ == "__main__":
    main()
