"""One script of py4dgeo, run by py4dgeo and by boresight.py4dgeo: the same distances, times side by side.

    python benches/m3c2.py [--points 1000000] [--corepoints 50000] [--rounds 3]

Times are those of `M3C2(...).run()` with everything that it builds: search trees, normals, distances.
"""

from __future__ import annotations

import argparse
import logging
import os
import statistics
import time
from typing import Any

import numpy as np
import py4dgeo

import boresight.py4dgeo


def field(points: int, up_m: float, seed: int) -> np.ndarray:
    """An uneven field with 2,000 points a square metre, metres."""
    rng = np.random.default_rng(seed)
    side = np.sqrt(points / 2000.0)
    at = rng.uniform(0.0, side, (points, 2))
    height = 0.05 * np.sin(2.0 * at[:, 0]) * np.cos(3.0 * at[:, 1]) + rng.normal(up_m, 0.003, points)
    return np.column_stack([at, height])


def compare(module: Any, clouds: list[np.ndarray], corepoints: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Wall and CPU time, seconds, and distances, metres."""
    wall, cpu = time.perf_counter(), time.process_time()
    distances, _ = module.M3C2(
        epochs=(module.Epoch(clouds[0]), module.Epoch(clouds[1])),
        corepoints=corepoints,
        cyl_radius=0.1,
        normal_radii=(0.2,),
        max_distance=0.5,
    ).run()
    return time.perf_counter() - wall, time.process_time() - cpu, distances


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--corepoints", type=int, default=50_000)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    logging.disable(logging.CRITICAL)
    clouds = [field(asked.points, 0.0, 1), field(asked.points, 0.004, 2)]
    corepoints = clouds[0][: asked.corepoints]
    times: dict[str, list[tuple[float, float]]] = {"py4dgeo": [], "boresight": []}
    found = {}
    for _ in range(asked.rounds):
        for name, module in (("py4dgeo", py4dgeo), ("boresight", boresight.py4dgeo)):
            wall, cpu, found[name] = compare(module, clouds, corepoints)
            times[name].append((wall, cpu))
    apart = np.abs(found["py4dgeo"] - found["boresight"])
    known = np.isfinite(apart)
    same = np.array_equal(np.isnan(found["py4dgeo"]), np.isnan(found["boresight"]))
    print(f"{asked.points} points each, {asked.corepoints} core points, load {os.getloadavg()[0]:.1f} at the end")
    for name, rounds in times.items():
        wall, cpu = (statistics.median(column) for column in zip(*rounds))
        print(f"  {name:9}  {wall:.2f} s, CPU {cpu:.2f} s, median of {len(rounds)}")
    print(
        f"  distances at {known.sum()} core points, apart by {apart[known].max():.1e} m at most, NaN at the same: {same}"
    )


if __name__ == "__main__":
    main()
