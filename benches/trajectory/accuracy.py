"""Prints root mean square errors of a trajectory table against the truth, as one JSON line.

usage: accuracy.py TRUTH_CSV TRAJECTORY_CSV

Both are tables with the columns time_s, east_m, north_m, up_m, qx, qy, qz, qw; poses are compared
if their times agree to 10 us. The position error is 3-D. The rotation error R_estimate R_truth^T is a vector
in world axes, whose horizontal part is the tilt and whose upward part is the yaw.
"""

import csv
import json
import sys

import numpy as np
from scipy.spatial.transform import Rotation

COLUMNS = ["time_s", "east_m", "north_m", "up_m", "qx", "qy", "qz", "qw"]
SAME_TIME_S = 1e-5


def read(path):
    with open(path, newline="") as file:
        names = [name.strip() for name in next(csv.reader(file))]
    return np.loadtxt(path, delimiter=",", skiprows=1, usecols=[names.index(c) for c in COLUMNS])


def errors(truth, found):
    """RMSE in mm and degrees of the poses `found` whose times are also in `truth`."""
    at = np.searchsorted(truth[:, 0], found[:, 0] - SAME_TIME_S)
    at = np.minimum(at, len(truth) - 1)
    met = np.abs(truth[at, 0] - found[:, 0]) < SAME_TIME_S
    if not met.any():
        raise SystemExit("no pose has a time of the truth")
    t, f = truth[at[met]], found[met]
    position = f[:, 1:4] - t[:, 1:4]
    turn = (Rotation.from_quat(f[:, 4:]) * Rotation.from_quat(t[:, 4:]).inv()).as_rotvec(degrees=True)
    rms = lambda x: float(np.sqrt(np.mean(np.sum(x**2, axis=1))))
    return {
        "poses": int(met.sum()),
        "position_rmse_mm": rms(position) * 1e3,
        "tilt_rmse_deg": rms(turn[:, :2]),
        "yaw_rmse_deg": rms(turn[:, 2:]),
    }


if __name__ == "__main__":
    print(json.dumps(errors(read(sys.argv[1]), read(sys.argv[2]))))
