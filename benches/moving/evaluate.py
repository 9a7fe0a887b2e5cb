"""Prints errors of the points of one drive, and the gap between its two scanners, as one JSON line.

usage: evaluate.py DRIVE --trajectory CSV --mountings FILE

DRIVE is a folder made by `boresight simulate`. Its points are placed with the given trajectory and
mountings, and with the true trajectory and mountings. Both placements use the same recorded points, so
that noise of the scanners cancels; the difference is the error vector of a point. Mountings are
constant, as in truth/mounting.toml, calibration.toml or a project, or given by time, as in mounting.csv.

points: root mean square of the 3-D error of all points on the field.
gap: means of the error vectors in cells of 5 cm that both scanners saw in one pass, within 5 s; root
mean squares of their difference, left minus right: along the normal of the plane through the true points
of the cell, upwards, and in 3-D.
"""

import argparse
import csv
import json
import tomllib
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

CELL_M, PASS_GAP_S = 0.05, 5.0
STAND_OFF_M, INVALID = 1.150, -32768
QUATERNION = ["qx", "qy", "qz", "qw"]


def table(path):
    """Columns of a CSV file by name; columns that are not numbers are returned as text."""
    with open(path, newline="") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    columns = {}
    for name, values in zip(rows[0], zip(*rows[1:])):
        try:
            columns[name.strip()] = np.array(values, dtype=float)
        except ValueError:
            columns[name.strip()] = np.array(values)
    return columns


class Transform:
    """A rigid transform as a function of time: linear, and along great circles, between its rows."""

    def __init__(self, time_s, position_m, rotation):
        self.time_s, self.position_m, self.rotation = np.asarray(time_s), np.asarray(position_m), rotation

    def at(self, time_s):
        """Rotations and translations; constant before the first and after the last row."""
        if len(self.time_s) == 1:
            n = len(time_s)
            return Rotation.from_quat(np.repeat(self.rotation.as_quat(), n, 0)), np.repeat(self.position_m, n, 0)
        time_s = np.clip(time_s, self.time_s[0], self.time_s[-1])
        position = [np.interp(time_s, self.time_s, self.position_m[:, i]) for i in range(3)]
        return Slerp(self.time_s, self.rotation)(time_s), np.column_stack(position)


def trajectory(path):
    rows = table(path)
    position = np.column_stack([rows[name] for name in ("east_m", "north_m", "up_m")])
    return Transform(rows["time_s"], position, Rotation.from_quat(np.column_stack([rows[q] for q in QUATERNION])))


def constant(scanner):
    """The transform of a [[scanner]] table; `bonn` angles describe the transposed rotation."""
    if "quaternion_xyzw" in scanner:
        rotation = Rotation.from_quat(scanner["quaternion_xyzw"])
    else:
        rotation = Rotation.from_euler("xyz", scanner["rotation_deg"], degrees=True)
        if scanner.get("rotation_convention", "zyx") == "bonn":
            rotation = rotation.inv()
    return Transform([0.0], [scanner["translation_m"]], Rotation.from_quat([rotation.as_quat()]))


def mountings(path):
    """body_from_scanner of every scanner, by name."""
    if Path(path).suffix == ".toml":
        return {scanner["name"]: constant(scanner) for scanner in tomllib.loads(Path(path).read_text())["scanner"]}
    rows, found = table(path), {}
    for name in np.unique(rows.get("scanner", "")):
        of = rows["scanner"] == name if name else slice(None)
        position = np.column_stack([rows[axis][of] for axis in ("x_m", "y_m", "z_m")])
        rotation = Rotation.from_quat(np.column_stack([rows[q][of] for q in QUATERNION]))
        found[str(name)] = Transform(rows["time_s"][of], position, rotation)
    return found


def truth(drive):
    """True trajectory and mountings."""
    found = mountings(drive / "truth" / "mounting.toml")
    for name in found:
        moving = drive / "truth" / f"mounting-{name}.csv"
        if moving.exists():
            found[name] = mountings(moving)[""]
    return trajectory(drive / "truth" / "trajectory.csv"), found


def profiles(path):
    """Times, x and z (m) of all profiles of a recording; NaN where nothing was measured."""
    width = int(np.fromfile(path, "<u4", 1, offset=52)[0])
    record = np.dtype([("time_s", "<f8"), ("_1", "V28"), ("offset_um", "<i4", 2), ("scale_nm", "<u4", 2),
                       ("_2", "V8"), ("x", "<i2", width), ("_3", "V4"), ("z", "<i2", width),
                       ("_4", "V28"), ("_5", "V", width)])
    rows = np.memmap(path, record, "r")
    seen = (rows["x"] != INVALID) & (rows["z"] != INVALID)
    z, x = (np.where(seen, raw * (scale[:, None] * 1e-9) + offset[:, None] * 1e-6, np.nan)
            for raw, scale, offset in zip((rows["z"], rows["x"]), rows["scale_nm"].T, rows["offset_um"].T))
    return np.array(rows["time_s"]), x, z - STAND_OFF_M


def errors(drive, poses, mounts):
    """For each scanner: times, true positions and error vectors of its points on the field."""
    size_m = tomllib.loads((drive / "truth" / "scene.toml").read_text())["field"]["size_m"]
    true_poses, true_mounts = truth(drive)
    for name in true_mounts:
        time_s, x, z = profiles(drive / f"{name}.bin")
        rows, columns = np.nonzero(np.isfinite(x))
        point = x[rows, columns], z[rows, columns]
        true = place(time_s, true_poses, true_mounts[name], rows, point)
        error = place(time_s, poses, mounts[name], rows, point) - true
        inside = np.all((true[:, :2] > 0) & (true[:, :2] < size_m), axis=1)
        yield time_s[rows][inside], true[inside], error[inside]


def place(time_s, poses, mounts, rows, point):
    """World positions of points x, z of the profiles `rows`."""
    (body, at), (turn, arm) = poses.at(time_s), mounts.at(time_s)
    matrix, shift = (body * turn).as_matrix(), at + body.apply(arm)
    return matrix[rows, :, 0] * point[0][:, None] + matrix[rows, :, 2] * point[1][:, None] + shift[rows]


def gaps(left, right):
    """For each cell and pass that both saw: difference of the mean errors, left minus right, and the normal."""
    time_s, true, error = (np.concatenate(pair) for pair in zip(left, right))
    is_left = np.arange(len(time_s)) < len(left[0])
    cell = np.floor(true[:, :2] / CELL_M).astype(np.int64)
    key = cell[:, 0] << 20 | cell[:, 1]
    # If a cell is seen again after a time, that is another pass.
    order = np.lexsort((time_s, key))
    new = (np.diff(key[order]) != 0) | (np.diff(time_s[order]) > PASS_GAP_S)
    group = np.empty(len(order), dtype=np.int64)
    group[order] = np.concatenate(([0], np.cumsum(new)))
    groups = group.max() + 1

    def means(of, *columns):
        n = np.bincount(group[of], minlength=groups)
        sums = [np.bincount(group[of], values[of], groups) for values in columns]
        return np.column_stack(sums) / np.maximum(n, 1)[:, None], n

    (l, n_left), (r, n_right) = (means(of, time_s, *error.T) for of in (is_left, ~is_left))
    both = (n_left > 0) & (n_right > 0) & (np.abs(l[:, 0] - r[:, 0]) < PASS_GAP_S)

    centred = true - means(slice(None), *true.T)[0][group]
    moments, _ = means(slice(None), *(centred[:, i] * centred[:, j] for i in range(3) for j in range(3)))
    normals = np.linalg.eigh(moments[both].reshape(-1, 3, 3))[1][:, :, 0]
    return (l - r)[both, 1:], normals


def rms(vectors):
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def evaluate(drive, poses, mounts):
    scanners = list(errors(drive, poses, mounts))
    gap, normals = gaps(*scanners)
    along = np.sum(gap * normals, axis=1, keepdims=True)
    return {
        "points": sum(len(error) for _, _, error in scanners),
        "points_mm": rms(np.concatenate([error for _, _, error in scanners])) * 1e3,
        "cells": len(gap),
        "gap_normal_mm": rms(along) * 1e3,
        "gap_up_mm": rms(gap[:, 2:]) * 1e3,
        "gap_3d_mm": rms(gap) * 1e3,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("drive", type=Path)
    parser.add_argument("--trajectory", type=Path, required=True)
    parser.add_argument("--mountings", type=Path, required=True)
    given = parser.parse_args()
    print(json.dumps(evaluate(given.drive, trajectory(given.trajectory), mountings(given.mountings))))


if __name__ == "__main__":
    main()
