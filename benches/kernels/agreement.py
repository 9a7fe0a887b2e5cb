"""Checks that boresight's numbers agree with those of other programs; prints one line per check.

usage: agreement.py BORESIGHT FOLDER (features CLOUD | thin CLOUD | m3c2 EPOCH1 EPOCH2 CORE)

Exit code 1 if a check fails; its line begins with FAILED. Tolerances:

- omnivariance 1e-6 relative: jakteristics returns single precision, which is accurate to 1e-7.
- M3C2 with given normals 1e-9 m, counts equal: both are double precision, coordinates are metres.
- M3C2 compared with CloudCompare's file: no farther from it than PDAL's, in median, rms and maximum. The
  files have three decimals, so ours are rounded to three decimals.
"""

import argparse
import json
import logging
import subprocess
import sys
from pathlib import Path

import jakteristics
import laspy
import numpy as np
import py4dgeo
from scipy.spatial import cKDTree

from with_peer import CYLINDER_RADIUS_M, MAX_DISTANCE_M, NEIGHBOURS, NORMAL_RADII_M, VOXEL_M

AUTZEN = Path(__file__).resolve().parents[2] / "tests" / "data" / "autzen_m3c2"
SAMPLE = 2000
CORE_SAMPLE = 50_000
OMNIVARIANCE_RELATIVE = 1e-6
DISTANCE_M = 1e-9
# If distances differ by less than this, rounding may change the choice of neighbours.
TIE_RELATIVE = 1e-12
AUTZEN_NORMAL_RADIUS, AUTZEN_CYLINDER_RADIUS, AUTZEN_HALF_LENGTH = 1.390432, 2.890432, 5.5


class Checks:
    """Prints the checks and counts failures."""

    def __init__(self):
        self.failed = 0

    def __call__(self, holds, text):
        self.failed += not holds
        print(text if holds else f"FAILED: {text}", flush=True)


def run(binary, out, *words):
    """The result of one boresight command."""
    out.mkdir(parents=True, exist_ok=True)
    command = [binary, *map(str, words), "--out", str(out), "--json", "--quiet"]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


def features(check, binary, out, cloud):
    """Omnivariance of a sample of points whose 50 nearest are unique."""
    points = np.load(cloud)
    run(binary, out, "features", cloud, "--neighbours", NEIGHBOURS, "--features", "omnivariance")
    ours = np.asarray(laspy.read(out / f"{cloud.stem}-features.laz")["omnivariance"], dtype=float)
    check(len(ours) == len(points), f"features: {len(ours)} values for {len(points)} points")
    some = np.random.default_rng(1).choice(len(points), min(SAMPLE, len(points)), replace=False)
    distance, near = cKDTree(points).query(points[some], NEIGHBOURS + 1)
    unique = distance[:, -1] > distance[:, -2] * (1.0 + TIE_RELATIVE)
    some, near = some[unique], near[unique, :NEIGHBOURS]
    around = points[near] - points[some][:, None]
    around -= around.mean(axis=1, keepdims=True)
    covariance = np.einsum("nki,nkj->nij", around, around) / NEIGHBOURS
    scipy = np.cbrt(np.prod(np.linalg.eigvalsh(covariance), axis=1))
    relative(check, "scipy (cKDTree, eigvalsh)", ours[some], scipy)
    # jakteristics has no search for the k nearest: it gets each neighbourhood as a separate cloud, and a
    # radius that contains all of it. It divides by n - 1, we divide by n.
    radius = float(2.0 * distance.max())
    jak = [jakteristics.compute_features(points[at], radius, num_threads=1, feature_names=["omnivariance"])[0, 0]
           for at in near]
    relative(check, "jakteristics (× (k − 1) / k)", ours[some], np.array(jak) * (NEIGHBOURS - 1) / NEIGHBOURS)


def relative(check, name, ours, theirs):
    worst = np.max(np.abs(ours / theirs - 1.0))
    check(worst <= OMNIVARIANCE_RELATIVE,
          f"omnivariance at {len(ours)} points with unique neighbours: {name} within {worst:.1e} relative "
          f"(limit {OMNIVARIANCE_RELATIVE:.0e})")


def thin(check, binary, out, cloud):
    """The point nearest to the centre of each occupied voxel, in the order of the file."""
    points = np.load(cloud)
    run(binary, out, "thin", cloud, "--voxel-m", VOXEL_M)
    kept = laspy.read(next(out.glob(f"{cloud.stem}-thin*")))
    voxel = np.floor(points / VOXEL_M)
    from_centre = np.sum((points - (voxel + 0.5) * VOXEL_M) ** 2, axis=1)
    voxel = (voxel - voxel.min(axis=0)).astype(np.int64)
    nx, ny, nz = voxel.max(axis=0) + 1
    code = (voxel[:, 0] * ny + voxel[:, 1]) * nz + voxel[:, 2]
    ranked = np.lexsort((from_centre, code))
    first = np.concatenate([[True], np.diff(code[ranked]) != 0])
    nearest = points[np.sort(ranked[first])]
    same = len(kept.points) == len(nearest)
    off = np.max(np.abs(kept.xyz - nearest) / kept.header.scales) if same else np.inf
    check(off <= 0.501, f"thinning: {len(kept.points)} points, {len(nearest)} by numpy; the same points in the same "
                        f"order, to {off:.3f} of the file's resolution")


def m3c2(check, binary, out, epoch1, epoch2, core):
    """Distances, level of detection, spreads and counts with py4dgeo's normals given."""
    py4dgeo.Epoch.set_default_radius_search_tree("octree")
    first, second, at = (np.load(path) for path in (epoch1, epoch2, core))
    at = at[:CORE_SAMPLE]
    algorithm = py4dgeo.M3C2(epochs=(py4dgeo.Epoch(first), py4dgeo.Epoch(second)), corepoints=at,
                             normal_radii=NORMAL_RADII_M, cyl_radius=CYLINDER_RADIUS_M, max_distance=MAX_DISTANCE_M)
    distance, more = algorithm.run()
    given = out / "core.csv"
    out.mkdir(parents=True, exist_ok=True)
    header = "east_m,north_m,up_m,normal_x,normal_y,normal_z"
    np.savetxt(given, np.hstack([at, algorithm.directions()]), fmt="%.17g", delimiter=",", header=header, comments="")
    ours = compared(binary, out, epoch2, epoch1, given, CYLINDER_RADIUS_M, MAX_DISTANCE_M)
    pairs = {
        "distance_m": distance, "level_of_detection_m": more["lodetection"],
        "reference_spread_m": more["spread1"], "compared_spread_m": more["spread2"],
    }
    counts = {"reference_count": more["num_samples1"], "compared_count": more["num_samples2"]}
    few = (more["num_samples1"] < 2) | (more["num_samples2"] < 2)
    worst, same_nan = {}, True
    for name, theirs in pairs.items():
        # Without points py4dgeo's spread is -0.0, ours is NaN.
        mine, theirs = ours[name][~few], theirs[~few]
        same_nan = same_nan and np.array_equal(np.isnan(mine), np.isnan(theirs))
        worst[name] = np.nanmax(np.abs(mine - theirs))
    check(same_nan and max(worst.values()) <= DISTANCE_M,
          f"M3C2 at {np.sum(~few)} of {len(at)} core points (the others have fewer than 2 points in a cylinder) with "
          f"py4dgeo's normals: {', '.join(f'{name} within {value:.1e}' for name, value in worst.items())}"
          f"{'' if same_nan else '; NaN at other core points'}")
    same = [int(np.sum(ours[name] == theirs)) for name, theirs in counts.items()]
    check(same == [len(at)] * 2, f"M3C2: counts equal at {same[0]} and {same[1]} of {len(at)} core points")


def compared(binary, out, cloud, reference, core, radius, half_length, *more):
    """The columns of boresight compare."""
    run(binary, out, "compare", cloud, reference, "--core", core, "--cylinder-radius-m", radius,
        "--max-distance-m", half_length, *more)
    return np.genfromtxt(out / "m3c2.csv", delimiter=",", names=True)


def autzen(check, binary, out, folder):
    """Comparison with CloudCompare's numbers, with our own normals; feet."""
    read = lambda name: np.genfromtxt(folder / name, delimiter=",", skip_header=1)
    cc, pdal = read("autzen-bmx-cc.txt"), read("autzen-bmx-m3c2.txt")
    out.mkdir(parents=True, exist_ok=True)
    core = out / "core.csv"
    np.savetxt(core, cc[:, :3], fmt="%.17g", delimiter=",", header="east_m,north_m,up_m", comments="")
    ours = compared(binary, out, folder / "autzen-bmx-2023.las", folder / "autzen-bmx-2010.las", core,
                    AUTZEN_CYLINDER_RADIUS, AUTZEN_HALF_LENGTH, "--normal-radii-m", AUTZEN_NORMAL_RADIUS)
    distance, counts = cc[:, 24], cc[:, 18:20]
    # CloudCompare writes 0 with an uncertainty of 0 if it has no normal; we write NaN.
    known = ~((distance == 0.0) & (cc[:, 23] == 0.0)) & ~np.isnan(distance)
    off = {"boresight": np.abs(np.round(ours["distance_m"], 3) - distance)[known],
           "PDAL": np.abs(pdal[:, 21] - distance)[known]}
    scatter = {name: [np.median(d), np.sqrt(np.mean(d**2)), np.max(d)] for name, d in off.items()}
    ours_counts = np.column_stack([ours["reference_count"], ours["compared_count"]])
    same = {"boresight": int(np.sum(np.all(ours_counts == counts, axis=1)[known])),
            "PDAL": int(np.sum(np.all(pdal[:, 26:28] == counts, axis=1)[known]))}
    text = "; ".join(f"{name} {', '.join(f'{x:.4f}' for x in scatter[name])}, counts equal at {same[name]}"
                     for name in scatter)
    holds = all(a <= b + 1e-9 for a, b in zip(scatter["boresight"], scatter["PDAL"]))
    holds = holds and same["boresight"] >= same["PDAL"]
    check(holds, f"M3C2 beside CloudCompare's file on autzen_m3c2, {np.sum(known)} core points, distances in feet off "
                 f"by median, rms, maximum: {text}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("boresight")
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("kernel", choices=["features", "thin", "m3c2"])
    arguments.add_argument("files", type=Path, nargs="+")
    given = arguments.parse_args()
    logging.getLogger("py4dgeo").setLevel(logging.WARNING)
    check, out = Checks(), given.folder / given.kernel
    {"features": features, "thin": thin, "m3c2": m3c2}[given.kernel](check, given.boresight, out, *given.files)
    if given.kernel == "m3c2":
        autzen(check, given.boresight, given.folder / "autzen", AUTZEN)
    return 1 if check.failed else 0


if __name__ == "__main__":
    sys.exit(main())
