"""Makes the clouds for all programs of the comparison, from a fixed seed.

usage: clouds.py FOLDER (features|thin|m3c2) POINTS [--core N]

A rough terrain of 10 points per cm²: x and y are uniform over a square, z is a sum of waves from 4 m down to
2 cm, whose height grows with their length (a fractal down to the finest wave), and 2 mm of noise. Files hold
float64 of shape (n, 3) and come in two orders: shuffled (no order at all) and ordered along a Morton
curve, in which points near each other in space are near each other in memory. No sensor measures in
Morton order; it is the best case for the caches, and real recordings lie between the two.

m3c2 makes two epochs of one surface, each with its own sample of points, the second deformed by up to 5 mm,
and core points drawn from the first. Prints the files and the radius that contains 50 neighbours as JSON.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

SEED = 20240328
POINTS_PER_M2 = 1e5
NOISE_M = 0.002
WAVES = 24
WAVELENGTHS_M = 4.0, 0.02
AMPLITUDE_OF_WAVELENGTH = 0.015
DEFORMATION_M = 0.005
NEIGHBOURS = 50
MORTON_CELL_M = 1e-3


def height(x, y):
    """The surface without noise, metres."""
    rng = np.random.default_rng(SEED)
    z = np.zeros_like(x)
    for length in np.geomspace(*WAVELENGTHS_M, WAVES):
        bearing, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        along = x * np.cos(bearing) + y * np.sin(bearing)
        z += AMPLITUDE_OF_WAVELENGTH * length * np.sin(2.0 * np.pi / length * along + phase)
    return z


def sample(n, stream):
    """`n` points of the surface, in random order."""
    rng = np.random.default_rng([SEED, stream])
    points = np.empty((n, 3))
    points[:, :2] = rng.uniform(0.0, np.sqrt(n / POINTS_PER_M2), (n, 2))
    points[:, 2] = height(points[:, 0], points[:, 1]) + rng.normal(0.0, NOISE_M, n)
    return points


def morton_order(points):
    """Indices that sort the points along a Morton curve of cells of 1 mm."""
    cells = ((points - points.min(axis=0)) / MORTON_CELL_M).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        x = cells[:, axis]
        for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
                            (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):
            x = (x | (x << np.uint64(shift))) & np.uint64(mask)
        code |= x << np.uint64(axis)
    return np.argsort(code, kind="stable")


def save(path, points):
    """Writes a file so that it is never incomplete."""
    unfinished = path.with_suffix(".tmp")
    with open(unfinished, "wb") as file:
        np.save(file, points)
    unfinished.rename(path)


def radius_of_neighbours(points):
    """Median distance to the 50th neighbour (the point itself is the first), metres."""
    some = points[:: max(1, len(points) // 2000)]
    distance, _ = cKDTree(points).query(some, [NEIGHBOURS])
    return float(np.median(distance))


def clouds(case, points, core):
    """The random clouds of a case by name."""
    if case != "m3c2":
        return {"cloud": sample(points, 0)}
    first, second = sample(points, 1), sample(points, 2)
    second[:, 2] += DEFORMATION_M * np.sin(2.0 * np.pi / 3.0 * second[:, 0])
    chosen = np.random.default_rng([SEED, 3]).choice(points, core, replace=False)
    return {"epoch1": first, "epoch2": second, "core": first[chosen]}


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("case", choices=["features", "thin", "m3c2"])
    arguments.add_argument("points", type=int)
    arguments.add_argument("--core", type=int, default=0)
    given = arguments.parse_args()
    name = f"{given.case}-{given.points}" + (f"-{given.core}" if given.core else "")
    listed = given.folder / f"{name}.json"
    if not listed.exists():
        given.folder.mkdir(parents=True, exist_ok=True)
        files, answer = {"shuffled": {}, "ordered": {}}, {}
        for which, points in clouds(given.case, given.points, given.core).items():
            for order in files:
                path = given.folder / f"{name}-{which}-{order}.npy"
                save(path, points if order == "shuffled" else points[morton_order(points)])
                files[order][which] = path.name
            if given.case == "features":
                answer["radius_m"] = radius_of_neighbours(points)
        answer["files"] = files
        listed.write_text(json.dumps(answer))
    print(listed.read_text())


if __name__ == "__main__":
    main()
