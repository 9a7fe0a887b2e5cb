"""Writes robust.csv: median and inter-quartile range by py4dgeo, for the same points as in the test.

    pip install py4dgeo==1.2.0
    python robust.py

Coordinates come from the linear congruential generator x <- (1664525 x + 1013904223) mod 2^32 with the
seed 1, as multiples of 2^-32, so that every language gives the same doubles. Normals are those of a
parabola, with components that are exact in binary or rounded once.
"""

from pathlib import Path

import numpy as np
import py4dgeo

state = 1


def draw():
    global state
    state = (1664525 * state + 1013904223) % 2**32
    return state / 2**32


def surface(n, offset):
    rows = []
    for _ in range(n):
        x, y, noise = draw(), draw(), draw()
        rows.append([x, y, 0.25 * x * x + offset + 0.03125 * (noise - 0.5)])
    return np.array(rows)


reference = surface(900, 0.0)
compared = surface(700, 0.0078125)
core = surface(120, 0.0)
normals = np.array([[-0.5 * x, 0.0, 1.0] for x in core[:, 0]])
normals /= np.sqrt(normals[:, :1] ** 2 + 1.0)

m3c2 = py4dgeo.M3C2(
    epochs=(py4dgeo.Epoch(reference), py4dgeo.Epoch(compared)),
    corepoints=core,
    corepoint_normals=normals,
    cyl_radius=0.0625,
    max_distance=0.125,
    registration_error=0.001,
    robust_aggr=True,
)
distance, uncertainty = m3c2.run()
with open(Path(__file__).with_suffix(".csv"), "w") as table:
    print(
        "distance_m,level_of_detection_m,reference_spread_m,compared_spread_m,"
        "reference_count,compared_count",
        file=table,
    )
    for d, u in zip(distance, uncertainty):
        row = [d, u["lodetection"], u["spread1"], u["spread2"]]
        cells = [repr(float(v)) for v in row] + [u["num_samples1"], u["num_samples2"]]
        print(*cells, sep=",", file=table)
