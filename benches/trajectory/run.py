#!/usr/bin/env python3
"""Compares boresight with gtsam on the same logs.

usage: python3 benches/trajectory/run.py [--quick] [--pose-case] [--drives 5,20,60] ...

Creates a virtual environment with gtsam, builds boresight, makes the logs, runs both in turn
(boresight, gtsam, boresight, ...) so that noise of the machine affects both, prints medians and ratios,
and writes them into docs/performance.md between its two markers.

Time of gtsam: only the time inside its C++ optimiser. The time of building the graph in Python is listed
separately; reading the logs and computing covariances are left out. Time of boresight: from parsed logs to
poses with standard deviations (`stages.estimate.seconds`), with nothing left out. Peak memory is that of
the whole process; for gtsam the memory before the first factor (Python, numpy, the logs) is subtracted,
for boresight nothing.
"""

import argparse
import json
import statistics
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from common import (MIB, ROOT, build, environment, heading_line, measured, median, number, ratio, row, say, version,
                    write)

PACKAGES = ["gtsam==4.3.0", "numpy", "scipy"]
MARGINALS_LIMIT_S = 120.0

# Runs on each drive: boresight's arguments, and gtsam's solver and nodes.
PAIRS = {
    "batch, IMU nodes": (("imu", []), ("lm", "imu")),
    "batch, IMU nodes, boresight on one thread": (("imu", ["--threads", "1"]), None),
    "batch, prism nodes": (("prism", []), ("lm", "prism")),
    "online, IMU nodes": (("imu", ["--online"]), ("isam2", "imu")),
}


def main():
    given = arguments()
    python = environment(given.venv, PACKAGES)
    binary = build()
    drives = logs(given, python)
    found = {}
    for minutes, folder in drives:
        repetitions = given.repetitions if minutes <= 5 else given.long_repetitions
        for what, (ours, theirs) in PAIRS.items():
            if theirs and theirs[0] == "isam2" and minutes > given.isam2_minutes:
                theirs = None
            found[folder.name, what] = alternate(python, binary, folder, ours, theirs, repetitions, given)
    extra = {folder.name: beyond_the_solution(python, folder) for minutes, folder in drives if minutes <= 5}
    text = report(given, python, binary, drives, found, extra)
    print(text)
    if not given.no_write:
        write("Trajectory", "benches/trajectory", text)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="only one drive of five minutes, three runs")
    parser.add_argument("--pose-case", action="store_true", help="run on tests/data/pose_case as well")
    parser.add_argument("--drives", default="5,20,60", metavar="MIN,MIN", help="lengths to simulate [5,20,60]")
    parser.add_argument("--repetitions", type=int, default=5, metavar="N", help="up to 5 minutes [5]")
    parser.add_argument("--long-repetitions", type=int, default=3, metavar="N", help="beyond 5 minutes [3]")
    parser.add_argument("--isam2-minutes", type=float, default=5.0, metavar="MIN",
                        help="longest drive for iSAM2, whose time grows with the square of the length [5]")
    parser.add_argument("--venv", type=Path, default=ROOT / "target" / "bench-venv", metavar="DIR")
    parser.add_argument("--work", type=Path, default=ROOT / "target" / "bench-trajectory", metavar="DIR")
    parser.add_argument("--plain-project", action="store_true",
                        help="for versions without `[trajectory] nodes`: IMU nodes only")
    parser.add_argument("--no-write", action="store_true", help="only print")
    given = parser.parse_args()
    if given.quick:
        given.drives = "" if given.pose_case else "5"
        given.repetitions = min(given.repetitions, 3)
    if not given.drives and not given.pose_case:
        parser.error("no drives and no --pose-case: nothing to run on")
    return given


def logs(given, python):
    """The length in minutes and the folder of every drive."""
    simulate = [python, str(HERE / "simulate.py")]
    drives = []
    if given.pose_case:
        folder = given.work / "pose_case"
        subprocess.run([*simulate, str(folder), "--convert", str(ROOT / "tests" / "data" / "pose_case")], check=True)
        drives.append((5.0, folder))
    for minutes in filter(None, given.drives.split(",")):
        folder = given.work / f"drive-{minutes}"
        say(f"simulating {minutes} minutes")
        subprocess.run([*simulate, str(folder), "--minutes", minutes], check=True)
        drives.append((float(minutes), folder))
    return drives


def boresight(python, binary, folder, nodes, flags, plain):
    """One run of boresight; None if this version cannot do it."""
    if plain and (nodes != "imu" or "--online" in flags):
        return None
    project = folder / ("project.toml" if plain else f"project-{nodes}.toml")
    out = folder / "out"
    command = [binary, "trajectory", str(project), "--json", "--quiet", "--out", str(out), *flags]
    run = measured(command)
    if run is None:
        return None
    result = json.loads(run.pop("out"))
    stages = result.get("stages", {})
    for name in ("estimate", "trajectory"):
        if name in stages:
            run["solve_s"], run["counted"] = stages[name]["seconds"], f"stages.{name}.seconds"
            break
    else:
        run["solve_s"], run["counted"] = run["wall_s"], "the whole process, files read and written"
    run["accuracy"] = accuracy(python, folder, out / "trajectory.csv")
    if "--online" in flags:
        online = result["online"]
        run.update({key: online[key] for key in ("updates", "update_ms_median", "update_ms_p999")})
        run["online"] = accuracy(python, folder, out / "online.csv")
    return run


def accuracy(python, folder, table):
    command = [python, str(HERE / "accuracy.py"), str(folder / "truth.csv"), str(table)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def gtsam(python, folder, solver, nodes, flags=()):
    run = measured([python, str(HERE / "with_gtsam.py"), str(folder), solver, nodes, *flags])
    if run is None:
        return None
    result = json.loads(run["out"])
    result["peak_bytes"] -= result["peak_bytes_before"]
    return result


def alternate(python, binary, folder, ours, theirs, repetitions, given):
    """The runs of both in turn."""
    runs = {"boresight": [], "gtsam": []}
    for n in range(repetitions):
        say(f"{folder.name}: {ours[0]} nodes {' '.join(ours[1])} {theirs or ''} {n + 1}/{repetitions}")
        if len(runs["boresight"]) == n:
            runs["boresight"] += filter(None, [boresight(python, binary, folder, *ours, given.plain_project)])
        if theirs and len(runs["gtsam"]) == n:
            runs["gtsam"] += filter(None, [gtsam(python, folder, *theirs)])
    return runs


def beyond_the_solution(python, folder):
    """gtsam's marginal covariances, and its accuracy with exact headings, for both kinds of nodes."""
    flags = ["--marginals", str(MARGINALS_LIMIT_S), "--exact-headings"]
    say(f"{folder.name}: gtsam's covariances")
    return {nodes: gtsam(python, folder, "lm", nodes, flags) for nodes in ("imu", "prism")}


def report(given, python, binary, drives, found, extra):
    packages = "from importlib.metadata import version as v; print('gtsam', v('gtsam'), 'numpy', v('numpy'))"
    lines = [
        heading_line("benches/trajectory/run.py", binary, version(python, "-c", packages)), "",
        "Medians; `gtsam : boresight` above 1 means that boresight needs less. On a machine that others use "
        "too, processor time (CPU s) is the steadier measure: gtsam's is that of its one thread in the "
        "optimiser, boresight's that of its whole process on all its threads.", "",
        row("drive", "what", "boresight s", "gtsam s", "gtsam : boresight", "boresight CPU s", "gtsam CPU s",
            "boresight MiB", "gtsam MiB", "runs"),
        row("---", "---", *["---:"] * 8),
    ]
    for (drive, what), runs in found.items():
        a, b = runs["boresight"], runs["gtsam"]
        if a or b:
            times = median(a, "solve_s"), median(b, "solve_s")
            cpu = median(a, "cpu_s"), median(b, "solve_cpu_s")
            memory = [None if not x else median(x, "peak_bytes") / MIB for x in (a, b)]
            lines.append(row(drive, what, number(times[0]), number(times[1]), ratio(times[1], times[0]),
                             number(cpu[0]), number(cpu[1]), number(memory[0]), number(memory[1]), f"{len(a)} / {len(b)}"))
    lines += ["", "Root mean square errors to the truth, of all poses at the end:", "",
              row("drive", "what", "boresight mm, tilt °, yaw °", "gtsam mm, tilt °, yaw °"), row(*["---"] * 4)]
    for (drive, what), runs in found.items():
        if "one thread" not in what and any(runs.values()):
            lines.append(row(drive, what, errors(runs["boresight"], "accuracy"), errors(runs["gtsam"], "accuracy")))
    lines += ["", "Online, one update a prism epoch; errors are those of the newest pose right after its update:", "",
              row("drive", "", "median ms", "99.9 % ms", "mm, tilt °, yaw °"), row("---", "---", "---:", "---:", "---")]
    for (drive, what), runs in found.items():
        for name in ("boresight", "gtsam"):
            if what.startswith("online") and runs[name]:
                x = runs[name]
                lines.append(row(drive, name, number(median(x, "update_ms_median")),
                                 number(median(x, "update_ms_p999")), errors(x, "online")))
    lines += ["", *notes(given, drives, found, extra)]
    return "\n".join(lines) + "\n"


def errors(runs, which):
    if not runs:
        return "–"
    keys = ("position_rmse_mm", "tilt_rmse_deg", "yaw_rmse_deg")
    return ", ".join(f"{median(runs, which, key):.4g}" for key in keys)


def notes(given, drives, found, extra):
    """Notes on results that are not in the tables."""
    lines = []
    counted = {run["counted"] for runs in found.values() for run in runs["boresight"]}
    if counted:
        lines.append(f"boresight's time is {' or '.join(sorted(counted))}, standard deviations of every pose "
                     "included. gtsam's is that inside its optimiser, without standard deviations.")
    built = [f"{median(runs['gtsam'], 'build_s'):.2f} s ({drive}, {what})"
             for (drive, what), runs in found.items() if runs["gtsam"]]
    if built:
        lines.append("Making gtsam's graph in Python is not counted; it took " + ", ".join(built) + ".")
    for drive, of_drive in extra.items():
        for nodes, run in filter(lambda pair: pair[1], of_drive.items()):
            m = run["marginals"]
            done = "all" if m["poses"] == m["of"] else f"only {m['poses']} (then the time was up) of"
            lines.append(f"{drive}, {nodes} nodes: gtsam's covariances of {done} {m['of']} poses take "
                         f"{m['seconds']:.2f} s more than its solution of {run['solve_s']:.2f} s. With roll and "
                         "pitch in the prior of every heading (see with_gtsam.py; solved twice) its errors are "
                         f"{errors([run], 'exact')}.")
    growing = [(drive, runs["gtsam"]) for (drive, what), runs in found.items()
               if what.startswith("online") and runs["gtsam"]]
    for drive, runs in growing:
        fifths = [statistics.median(x) for x in zip(*(run["update_ms_median_of_fifths"] for run in runs))]
        lines.append(f"gtsam's median update in each fifth of {drive}: "
                     + ", ".join(f"{x:.1f}" for x in fifths) + " ms.")
    linear = [(minutes, median(found[folder.name, "batch, IMU nodes"]["boresight"], "solve_s"))
              for minutes, folder in drives if folder.name != "pose_case"]
    linear = [f"{seconds / minutes * 1e3:.1f} ms ({minutes:g} min)" for minutes, seconds in linear if seconds]
    if len(linear) > 1:
        lines.append("boresight's time a minute of drive, IMU nodes: " + ", ".join(linear) + ".")
    if any(minutes > given.isam2_minutes for minutes, _ in drives):
        lines.append(f"iSAM2 is not run beyond {given.isam2_minutes:g} minutes: its time grows with the square "
                     "of the length.")
    return [text for line in lines for text in (line, "")]


if __name__ == "__main__":
    main()
