"""Writes logs of a simulated drive in boresight's own formats, and the truth.

usage: simulate.py OUT_DIR --minutes M [--seed 1]
       simulate.py OUT_DIR --convert POSE_CASE_DIR

The robot rests for 10 s, starts within 5 s and then drives laps of an oval of about 6.5 m by 4.6 m
at 0.15 m/s over rough ground. World: east, north, up. Body FLU: x forward, y left, z up, with
world_from_body = Rz(yaw) Ry(pitch) Rx(roll); heading = 90 deg - yaw.

IMU 100 Hz: row k is the mean angular rate and specific force over [t_k, t_k + 10 ms), plus bias,
plus white noise; biases walk. Prism 7 Hz and heading 5 Hz are taken at the IMU time nearest to each
of their ticks, since a factor graph without interpolation can only use fixes at its nodes.

With --convert, a folder in the form of tests/data/pose_case is written in boresight's form instead.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY_M_S2 = 9.81
STANDARD_GRAVITY_M_S2 = 9.80665
IMU_HZ, PRISM_HZ, HEADING_HZ = 100, 7.0, 5.0
SUBSTEPS = 10  # steps of the truth in one IMU sample
CHUNK = 60 * IMU_HZ  # IMU samples simulated at a time

LEVER_ARM_M = np.array([0.20, 0.05, 1.50])
PRISM_SIGMA_M = 0.005
HEADING_SIGMA_RAD = np.radians(0.7)
GYRO_DENSITY = 4.4e-5  # rad/s/sqrt(Hz)
ACCEL_DENSITY = 5.6e-4  # m/s2/sqrt(Hz)
GYRO_WALK = 2e-6  # rad/s/sqrt(s)
ACCEL_WALK = 2e-5  # m/s2/sqrt(s)
GYRO_TURN_ON = np.array([1.5e-3, -1.0e-3, 0.8e-3])
ACCEL_TURN_ON = np.array([0.03, -0.02, 0.04])

REST_S, START_S = 10.0, 5.0
OVAL_RAD_S = 0.057  # rate of the curve parameter at full speed


def state(t):
    """Position, yaw and world_from_body at the times t."""
    u = np.clip((t - REST_S) / START_S, 0.0, 1.0)
    # The speed follows the smooth step 6u^5 - 15u^4 + 10u^3; this is its integral.
    driven = START_S * (u**6 - 3 * u**5 + 2.5 * u**4) + np.maximum(t - REST_S - START_S, 0.0)
    step = u**3 * (10 - 15 * u + 6 * u**2)
    s = OVAL_RAD_S * driven
    wave = lambda hz, phase=0.0: np.sin(2 * np.pi * hz * t + phase)
    position = np.stack(
        [
            3.0 * np.cos(s) + 0.25 * np.cos(3 * s),
            2.3 * np.sin(s),
            step * (0.010 * wave(0.21) + 0.003 * wave(1.1, 1.0)),
        ],
        axis=1,
    )
    along = np.arctan2(2.3 * np.cos(s), -3.0 * np.sin(s) - 0.75 * np.sin(3 * s))
    yaw = along + np.radians(0.5) * step * wave(0.6)
    pitch = np.radians(-0.4 + step * (0.9 * wave(0.43, 2.0) + 0.3 * wave(1.3)))
    roll = np.radians(0.6 + step * (1.2 * wave(0.31) + 0.4 * wave(1.7)))
    return position, yaw, Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))


def ideal_imu(first, count):
    """Mean angular rate and specific force of the IMU samples first .. first + count - 1."""
    h = 1.0 / (IMU_HZ * SUBSTEPS)
    edges = (first * SUBSTEPS + np.arange(count * SUBSTEPS + 1)) * h
    middle = edges[:-1] + h / 2
    _, _, at_edges = state(edges)
    rate = (at_edges[:-1].inv() * at_edges[1:]).as_rotvec() / h
    d = 1e-3  # step of the central difference: truncation and rounding are both below 1e-6 m/s2
    before, here, after = (state(middle + shift)[0] for shift in (-d, 0.0, d))
    acceleration = (after - 2 * here + before) / d**2
    force = state(middle)[2].inv().apply(acceleration + [0, 0, GRAVITY_M_S2])
    mean = lambda x: x.reshape(count, SUBSTEPS, 3).mean(axis=1)
    return mean(rate), mean(force)


def simulate(seconds, rng):
    """imu, prism, heading (radians clockwise from north) and truth as arrays of their columns."""
    n = int(round(seconds * IMU_HZ))
    dt = 1.0 / IMU_HZ
    parts = [ideal_imu(k, min(CHUNK, n - k)) for k in range(0, n, CHUNK)]
    rate, force = (np.concatenate(part) for part in zip(*parts))
    walk = lambda sigma: np.cumsum(rng.normal(0, sigma * np.sqrt(dt), (n, 3)), axis=0)
    white = lambda density: rng.normal(0, density / np.sqrt(dt), (n, 3))
    gyro = rate + GYRO_TURN_ON + walk(GYRO_WALK) + white(GYRO_DENSITY)
    accel = force + ACCEL_TURN_ON + walk(ACCEL_WALK) + white(ACCEL_DENSITY)
    t = np.arange(n + 1) * dt
    position, yaw, rotation = state(t)

    def ticks(hz):
        at = np.round(np.arange(0, seconds + 1e-9, 1 / hz) * IMU_HZ).astype(int)
        return np.unique(at[at <= n])

    i = ticks(PRISM_HZ)
    prism = position[i] + rotation[i].apply(LEVER_ARM_M) + rng.normal(0, PRISM_SIGMA_M, (len(i), 3))
    j = ticks(HEADING_HZ)
    heading = np.pi / 2 - yaw[j] + rng.normal(0, HEADING_SIGMA_RAD, len(j))
    return (
        np.column_stack([t[:-1], gyro, accel]),
        np.column_stack([t[i], prism]),
        np.column_stack([t[j], heading]),
        np.column_stack([t, position, rotation.as_quat()]),
    )


SIMULATED = {
    "gravity_mps2": GRAVITY_M_S2,
    "lever_b_m": LEVER_ARM_M.tolist(),
    "sigma_prism_m": PRISM_SIGMA_M,
    "sigma_heading_rad": float(HEADING_SIGMA_RAD),
    "gyro_noise_density": GYRO_DENSITY,
    "accel_noise_density": ACCEL_DENSITY,
    "gyro_bias_rw": GYRO_WALK,
    "accel_bias_rw": ACCEL_WALK,
}


def convert(folder):
    """Reads a folder in the form of tests/data/pose_case, with the constants that an estimator may know."""
    table = lambda name: np.loadtxt(folder / name, delimiter=",", skiprows=1)
    timed = lambda rows: np.column_stack([np.arange(len(rows)) / IMU_HZ, rows])
    heading = table("heading.csv")
    heading[:, 1] = np.pi / 2 - heading[:, 1]
    truth = timed(np.load(folder / "truth.npy"))[:, [0, 1, 2, 3, 5, 6, 7, 4]]
    known = json.loads((folder / "params.json").read_text())
    return timed(np.load(folder / "imu.npy")), table("prism.csv"), heading, truth, known


PROJECT = """[frame]
body = "FLU"
gravity_m_s2 = {gravity!r}

[imu]
file = "imu.csv"
gyro_noise_deg_sqrt_h = {gyro!r}
accel_noise_ug_sqrt_hz = {accel!r}
gyro_bias_walk_rad_s_sqrt_s = {gyro_walk!r}
accel_bias_walk_m_s2_sqrt_s = {accel_walk!r}

[prism]
file = "prism.csv"
sigma_m = {prism!r}
lever_arm_m = {lever!r}

[heading]
file = "heading.csv"
sigma_deg = {heading!r}
"""


def write(out, imu, prism, heading, truth, known):
    out.mkdir(parents=True, exist_ok=True)

    def save(name, header, rows):
        np.savetxt(out / name, rows, delimiter=",", header=header, comments="", fmt="%.12g")

    imu_header = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
    save("imu.csv", imu_header, imu)
    save("prism.csv", "time_s,east_m,north_m,up_m", prism)
    degrees = np.degrees(np.remainder(heading[:, 1:], 2 * np.pi))
    save("heading.csv", "time_s,heading_deg", np.hstack([heading[:, :1], degrees]))
    save("truth.csv", "time_s,east_m,north_m,up_m,qx,qy,qz,qw", truth)
    text = PROJECT.format(
        gravity=known["gravity_mps2"],
        gyro=float(np.degrees(known["gyro_noise_density"]) * 60.0),
        accel=known["accel_noise_density"] / STANDARD_GRAVITY_M_S2 * 1e6,
        gyro_walk=known["gyro_bias_rw"],
        accel_walk=known["accel_bias_rw"],
        prism=known["sigma_prism_m"],
        lever=known["lever_b_m"],
        heading=float(np.degrees(known["sigma_heading_rad"])),
    )
    (out / "project.toml").write_text(text)
    for nodes in ("imu", "prism"):
        (out / f"project-{nodes}.toml").write_text(f'{text}\n[trajectory]\nnodes = "{nodes}"\n')


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("out", type=Path)
    source = arguments.add_mutually_exclusive_group(required=True)
    source.add_argument("--minutes", type=float)
    source.add_argument("--convert", type=Path)
    arguments.add_argument("--seed", type=int, default=1)
    given = arguments.parse_args()
    if given.convert:
        write(given.out, *convert(given.convert))
    else:
        rng = np.random.default_rng(given.seed)
        write(given.out, *simulate(60.0 * given.minutes, rng), SIMULATED)


if __name__ == "__main__":
    main()
