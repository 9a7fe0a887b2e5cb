"""The tables of docs/performance.md, from the runs of run.py."""

import hashlib
from itertools import groupby

from common import MIB, heading_line, median, number, ratio, row

COUNTED = {
    "features": "open3d: `estimate_covariances` (k nearest) and the cube root of the determinant by numpy. small_gicp: "
                "`estimate_covariances`, whose eigenvalues it replaces by fixed ones, so that no omnivariance can be "
                "had from them: a lower bound for what it would take. jakteristics: neighbours within the radius that "
                "holds 50 in the median, as it cannot search for the k nearest. pgeof: `knn_search` and "
                "`compute_features`, in single precision.",
    "thin": "The cloud holds about 1.8 points a voxel. small_gicp: `voxelgrid_sampling`. open3d: `voxel_down_sample` "
            "of `open3d.geometry`, which works on one thread, and of `open3d.t.geometry`. They average the points of a "
            "voxel; boresight keeps the one nearest to its centre.",
    "m3c2": "py4dgeo: `M3C2.run`, with either of its search trees. With its k-d tree, the default, and several radii "
            "for normals, py4dgeo 1.2.0 counts inner points twice in the normals; with its octree it does not.",
}


def digest(path):
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def report(sections, binary):
    cases = [case for section in sections.values() for case in section["cases"]]
    versions = {run["version"] for case in cases for run in case["runs"] if "version" in run}
    lines = [heading_line("benches/kernels/run.py", binary, ", ".join(sorted(versions))), "",
             "Median seconds from points in memory to results in memory, search structures included. `peer : "
             "boresight` above 1 means that boresight needs less. Shuffled points have no order at all; ordered ones "
             "lie along a Morton curve, which favours programs that do not sort. The programs take turns; on a "
             "machine that others use too, processor time (CPU s) is the steadier measure; boresight's is that of its "
             "whole process, reading and writing included.", "",
             *best_lines(cases), ""]
    for section in sections.values():
        lines += section_lines(section)
    lines += ["### Agreement", ""]
    lines += [f"- {line}" for section in sections.values() for line in section["agreed"]]
    return "\n".join([*lines, "", *process_lines(cases)]) + "\n"


def peers(sections):
    """The tables without boresight."""
    return "\n".join(line for section in sections.values() for line in section_lines(section))


def section_lines(section):
    lines = []
    for case in section["cases"]:
        lines += [f"### {case['title']}", "", f"{COUNTED[case['kernel']]} ({section['measured']}.)", "",
                  *case_lines(case), ""]
        lines += deterministic(case) if case["kernel"] == "thin" else []
    return lines + index_lines(section.get("indices", []))


def programs(case):
    """The runs of each order, number of threads and program."""
    found = {}
    for run in case["runs"]:
        found.setdefault((run["order"], run["threads"], run["program"]), []).append(run)
    return found


def rate(case, seconds):
    return None if seconds is None else case["units"] / seconds / 1e6


def best_lines(cases):
    """boresight compared with the fastest peer of each case."""
    lines = [row("case", "points", "threads", "best peer", "M/s", "boresight M/s", "best peer : boresight", "goal"),
             row("---", "---", "---:", "---", *["---:"] * 4)]
    for case in cases:
        times = {key: median(runs, "seconds") for key, runs in programs(case).items()}
        for order, threads in dict.fromkeys(key[:2] for key in times):
            of = {name: s for (o, t, name), s in times.items() if (o, t) == (order, threads)}
            ours = of.pop("boresight", None)
            name, theirs = min(of.items(), key=lambda item: item[1], default=("–", None))
            lines.append(row(f"{case['kernel']}, {case['points'] / 1e6:g} M", order, str(threads), name,
                             number(rate(case, theirs)), number(rate(case, ours)), ratio(theirs, ours),
                             f"{case['goal']:g}"))
    return [*lines, "", "M/s: million points a second, for M3C2 million core points a second."]


def case_lines(case):
    """Every program of a case."""
    unit = "core points" if case["kernel"] == "m3c2" else "points"
    lines = [row("points", "threads", "program", "s", "of it", "CPU s", f"M {unit}/s", "peer : boresight", "runs"),
             row("---", "---:", "---", "---:", "---", *["---:"] * 4)]
    found = programs(case)
    for (order, threads, name), runs in found.items():
        seconds = median(runs, "seconds")
        ours = median(found.get((order, threads, "boresight")), "seconds")
        cpu = median(runs, "process_cpu_s" if name == "boresight" else "cpu_s")
        lines.append(row(order, str(threads), name, number(seconds), parts(runs), number(cpu),
                         number(rate(case, seconds)), "" if name == "boresight" else ratio(seconds, ours),
                         str(len(runs))))
    return lines


def parts(runs):
    """The median seconds of each relevant part, if there is more than one."""
    names = [name for name in runs[0]["parts"] if name != "copying in"]
    return ", ".join(f"{name} {number(median(runs, 'parts', name))}" for name in names) if len(names) > 1 else ""


def deterministic(case):
    """The programs that gave the same bytes in every run, with both numbers of threads."""
    lines = ["Results by their bytes, at one and two threads:", ""]
    for name in dict.fromkeys(run["program"] for run in case["runs"]):
        said = []
        for order in dict.fromkeys(run["order"] for run in case["runs"]):
            hashes = [run["sha256"] for run in case["runs"] if (run["program"], run["order"]) == (name, order)]
            count = len(set(hashes))
            said.append(f"{order} {count} {'result' if count == 1 else 'different results'} in {len(hashes)} runs")
        lines.append(f"- {name}: {'; '.join(said)}")
    return [*lines, ""]


def index_lines(indices):
    """The neighbour indices of crates."""
    if not indices:
        return []
    lines = ["### Neighbour indices in Rust", "",
             "The 50 nearest neighbours of every point; the sums of the distances to the farthest agree to 1e-9. "
             "Queries in the order of the file, but `nearest_of_all` and `surroundings_of_all` find an order of their "
             "own; the latter also computes structure tensors.", "",
             row("cloud", "points", "threads", "index", "build s", "query s", "M points/s"),
             row("---", "---", "---:", "---", *["---:"] * 3)]
    key = lambda run: (run["points"], run["order"] != "shuffled", run["threads"], run["index"])
    for _, runs in groupby(sorted(indices, key=key), key):
        runs = list(runs)
        first = runs[0]
        build, query = median(runs, "build_s"), median(runs, "query_s")
        lines.append(row(f"{first['points'] / 1e6:g} M", first["order"], str(first["threads"]), first["index"],
                         number(build), number(query), number(first["points"] / (build + query) / 1e6)))
    return [*lines, ""]


def process_lines(cases):
    """Whole processes, including reading, writing and start-up."""
    lines = ["### Whole processes", "",
             "boresight reads the points and writes results to disk; peers start Python, read the points and write "
             "nothing. Shuffled points.", "",
             row("case", "threads", "program", "wall s", "CPU s", "MiB"), row("---", "---:", "---", *["---:"] * 3)]
    for case in cases:
        for (order, threads, name), runs in programs(case).items():
            if order == "shuffled":
                lines.append(row(f"{case['kernel']}, {case['points'] / 1e6:g} M", str(threads), name,
                                 number(median(runs, "wall_s")), number(median(runs, "process_cpu_s")),
                                 number(median(runs, "peak_bytes") / MIB)))
    return lines
