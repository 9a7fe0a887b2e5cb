"""Runs gtsam on boresight's logs, with the same factors and the same sigmas; prints one JSON line.

usage: with_gtsam.py CASE_DIR lm|isam2 imu|prism [--marginals SECONDS] [--exact-headings]

CASE_DIR holds the output of simulate.py. `lm` is Levenberg-Marquardt over the whole drive; `isam2` is
one incremental update per prism epoch. Nodes are at every IMU sample or at prism epochs only; biases are
at prism epochs in both cases. Factors, all evaluated in C++: ImuFactor, BetweenFactorConstantBias,
GPSFactorArm (prism with lever arm), PoseRotationPrior3D (heading; a sigma of 10 rad leaves roll and
pitch free). With nodes at prism epochs, a heading is moved to the nearest node by the integrated gyro.

PoseRotationPrior3D uses the upward part of the rotation's logarithm as the yaw error. That is off by
about half of roll times pitch, 0.002 deg on a robot that leans by 0.6 and 0.4 deg. With
--exact-headings the drive is solved once more with the estimated roll and pitch in the prior's rotation,
so that the error is that of the yaw alone; the accuracy of this solution is reported as well.

gtsam 4.3.0 walks its elimination trees recursively and overflows a stack of 8 MiB on long drives, so
the script requests an unlimited stack. iSAM2 eliminates by QR, which gtsam names for poorly conditioned
problems: with its default, Cholesky, it stops in the first update at IMU nodes ("indeterminate
linear system"). Relinearisation is checked at every update, with a threshold of 0.01.

Times: `solve_s` is the time inside gtsam's optimiser (for isam2: its updates with the newest pose
asked for, and the full trajectory at the end). `build_s`, the time in which Python makes the graph
and gtsam integrates the IMU samples in it, is told apart and not counted.
"""

import argparse
import json
import os
import resource
import sys
import time
import tomllib
from importlib import metadata
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from scipy.spatial.transform import Rotation

from accuracy import errors, read

STANDARD_GRAVITY_M_S2 = 9.80665
INTEGRATION_SIGMA = 1e-5  # m/sqrt(s)
REST_S = 5.0  # standstill at the start, used for the first gyro bias
ATTITUDE0_SIGMA_RAD, VELOCITY0_SIGMA_M_S = 0.1, 0.05
ACCEL_BIAS0_SIGMA, GYRO_BIAS0_SIGMA = 0.1, 5e-3


def peak_bytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


class Stopwatch:
    """Adds up wall and processor time of the code inside `with`."""

    def __init__(self):
        self.wall, self.cpu, self.last = 0.0, 0.0, 0.0

    def __enter__(self):
        self._start = time.perf_counter(), time.process_time()

    def __exit__(self, *_):
        self.last = time.perf_counter() - self._start[0]
        self.wall += self.last
        self.cpu += time.process_time() - self._start[1]


class Drive:
    """The logs and their settings in the project file."""

    def __init__(self, folder):
        table = lambda name: np.loadtxt(folder / name, delimiter=",", skiprows=1)
        project = tomllib.loads((folder / "project.toml").read_text())
        imu, prism, heading = table("imu.csv"), table("prism.csv"), table("heading.csv")
        self.dt = float(np.median(np.diff(imu[:, 0])))
        self.t0 = imu[0, 0]
        self.gyro, self.accel = imu[:, 1:4].copy(), imu[:, 4:7].copy()
        sample = lambda t: np.round((t - self.t0) / self.dt).astype(int)
        self.prism_at, self.prism = sample(prism[:, 0]), prism[:, 1:4].copy()
        self.heading_at, self.yaw = sample(heading[:, 0]), np.pi / 2 - np.radians(heading[:, 1])
        noise = project["imu"]
        self.gyro_density = np.radians(noise["gyro_noise_deg_sqrt_h"] / 60.0)
        self.accel_density = noise["accel_noise_ug_sqrt_hz"] * 1e-6 * STANDARD_GRAVITY_M_S2
        self.gyro_walk = noise["gyro_bias_walk_rad_s_sqrt_s"]
        self.accel_walk = noise["accel_bias_walk_m_s2_sqrt_s"]
        self.gravity = project["frame"]["gravity_m_s2"]
        self.lever = np.array(project["prism"]["lever_arm_m"])
        self.prism_sigma = project["prism"]["sigma_m"]
        self.heading_sigma = np.radians(project["heading"]["sigma_deg"])


class Factors:
    """Makes the factors of one drive, epoch by epoch."""

    def __init__(self, drive, nodes):
        d, self.drive, self.nodes = drive, drive, nodes
        self.imu = gtsam.PreintegrationParams.MakeSharedU(d.gravity)
        self.imu.setGyroscopeCovariance(np.eye(3) * d.gyro_density**2)
        self.imu.setAccelerometerCovariance(np.eye(3) * d.accel_density**2)
        self.imu.setIntegrationCovariance(np.eye(3) * INTEGRATION_SIGMA**2)
        diagonal = gtsam.noiseModel.Diagonal.Sigmas
        self.prism_noise = gtsam.noiseModel.Isotropic.Sigma(3, d.prism_sigma)
        self.heading_noise = diagonal(np.array([10.0, 10.0, d.heading_sigma]))
        resting = d.gyro[: int(REST_S / d.dt)].mean(axis=0)
        self.bias0 = gtsam.imuBias.ConstantBias(np.zeros(3), resting)
        self.leaning = None  # the rotation of a node, if the headings must be exact
        self.prism_of = {int(i): k for k, i in enumerate(d.prism_at)}
        turned = np.concatenate([[0.0], np.cumsum((d.gyro[:, 2] - resting[2]) * d.dt)])
        self.headings_of = {}
        for i, yaw in zip(d.heading_at, d.yaw):
            j = int(i if nodes == "imu" else d.prism_at[np.argmin(np.abs(d.prism_at - i))])
            self.headings_of.setdefault(j, []).append(yaw + turned[j] - turned[i])

    def start(self, graph):
        diagonal, isotropic = gtsam.noiseModel.Diagonal.Sigmas, gtsam.noiseModel.Isotropic.Sigma
        level = diagonal(np.array([ATTITUDE0_SIGMA_RAD, ATTITUDE0_SIGMA_RAD, 10.0]))
        graph.add(gtsam.PoseRotationPrior3D(X(0), gtsam.Rot3(), level))
        graph.add(gtsam.PriorFactorVector(V(0), np.zeros(3), isotropic(3, VELOCITY0_SIGMA_M_S)))
        bias = diagonal(np.array([ACCEL_BIAS0_SIGMA] * 3 + [GYRO_BIAS0_SIGMA] * 3))
        graph.add(gtsam.PriorFactorConstantBias(B(0), self.bias0, bias))
        self.fixes(graph, 0)

    def fixes(self, graph, i):
        d, k = self.drive, self.prism_of.get(i)
        if k is not None:
            graph.add(gtsam.GPSFactorArm(X(i), d.prism[k], d.lever, self.prism_noise))
        for yaw in self.headings_of.get(i, ()):
            pitch, roll = self.leaning(i).ypr()[1:] if self.leaning else (0.0, 0.0)
            rotation = gtsam.Rot3.Ypr(yaw, pitch, roll)
            graph.add(gtsam.PoseRotationPrior3D(X(i), rotation, self.heading_noise))

    def epoch(self, graph, k, bias):
        """Adds the factors between the prism epochs k - 1 and k, with the IMU integrated about `bias`.

        Returns the new nodes with the preintegrated measurement that leads to each."""
        d = self.drive
        first, last = int(d.prism_at[k - 1]), int(d.prism_at[k])
        dt = (last - first) * d.dt
        walk = np.array([d.accel_walk] * 3 + [d.gyro_walk] * 3) * np.sqrt(dt)
        walk = gtsam.noiseModel.Diagonal.Sigmas(walk)
        graph.add(gtsam.BetweenFactorConstantBias(B(k - 1), B(k), gtsam.imuBias.ConstantBias(), walk))
        ends = range(first + 1, last + 1) if self.nodes == "imu" else [last]
        made, i = [], first
        for j in ends:
            between = gtsam.PreintegratedImuMeasurements(self.imu, bias)
            for s in range(i, j):
                between.integrateMeasurement(d.accel[s], d.gyro[s], d.dt)
            graph.add(gtsam.ImuFactor(X(i), V(i), X(j), V(j), B(k - 1), between))
            self.fixes(graph, j)
            made.append((j, between))
            i = j
        return made


def levenberg_marquardt(factors, marginals_s):
    d, build, solve = factors.drive, Stopwatch(), Stopwatch()
    epochs = len(d.prism_at)
    with build:
        graph, values, ends = gtsam.NonlinearFactorGraph(), gtsam.Values(), [0]
        factors.start(graph)
        for k in range(1, epochs):
            ends.extend(j for j, _ in factors.epoch(graph, k, factors.bias0))
        # The start does not use the truth: level attitude, interpolated headings and prism positions.
        yaw = np.interp(ends, d.heading_at, np.unwrap(d.yaw))
        prism = np.stack([np.interp(ends, d.prism_at, d.prism[:, a]) for a in range(3)], axis=1)
        position = prism - Rotation.from_euler("Z", yaw[:, None]).apply(d.lever)
        box = lambda x: np.convolve(np.pad(x, 7, mode="edge"), np.ones(15) / 15, "valid")
        smooth = np.stack([box(d.prism[:, a]) for a in range(3)], axis=1)
        velocity = np.gradient(smooth, d.prism_at * d.dt, axis=0)
        velocity = np.stack([np.interp(ends, d.prism_at, velocity[:, a]) for a in range(3)], axis=1)
        for n, i in enumerate(ends):
            values.insert(X(i), gtsam.Pose3(gtsam.Rot3.Yaw(yaw[n]), position[n]))
            values.insert(V(i), velocity[n])
        for k in range(epochs):
            values.insert(B(k), factors.bias0)
    with solve:
        optimiser = gtsam.LevenbergMarquardtOptimizer(graph, values, gtsam.LevenbergMarquardtParams())
        found = optimiser.optimize()
    report = {"build_s": build.wall, "solve_s": solve.wall, "solve_cpu_s": solve.cpu,
              "iterations": optimiser.iterations(), "peak_bytes": peak_bytes()}
    if marginals_s:
        report["marginals"] = marginals(graph, found, ends, marginals_s)
    return ends, found, report


def marginals(graph, found, ends, limit_s):
    """Computes every pose's covariance within a time limit, and reports how many were computed."""
    watch = Stopwatch()
    with watch:
        all_of_them = gtsam.Marginals(graph, found)
    seconds, done = watch.wall, 0
    for i in ends:
        if seconds > limit_s:
            break
        with watch:
            all_of_them.marginalCovariance(X(i))
        seconds, done = watch.wall, done + 1
    return {"seconds": seconds, "poses": done, "of": len(ends), "peak_bytes": peak_bytes()}


def isam2(factors):
    d, build, solve = factors.drive, Stopwatch(), Stopwatch()
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(0.01)
    parameters.relinearizeSkip = 1
    parameters.setFactorization("QR")
    smoother = gtsam.ISAM2(parameters)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    factors.start(graph)
    level = gtsam.Rot3.Yaw(d.yaw[0])
    pose, velocity, bias = gtsam.Pose3(level, d.prism[0] - level.matrix() @ d.lever), np.zeros(3), factors.bias0
    values.insert(X(0), pose)
    values.insert(V(0), velocity)
    values.insert(B(0), bias)
    with solve:
        smoother.update(graph, values)
    updates_s, online, ends = [], [], [0]
    for k in range(1, len(d.prism_at)):
        with build:
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            predicted = gtsam.NavState(pose, velocity)
            for j, between in factors.epoch(graph, k, bias):
                predicted = between.predict(predicted, bias)
                values.insert(X(j), predicted.pose())
                values.insert(V(j), predicted.velocity())
                ends.append(j)
            values.insert(B(k), bias)
        with solve:
            smoother.update(graph, values)
            pose = smoother.calculateEstimatePose3(X(ends[-1]))
            velocity = smoother.calculateEstimateVector(V(ends[-1]))
            bias = smoother.calculateEstimateConstantBias(B(k))
        updates_s.append(solve.last)
        online.append((ends[-1], pose))
    with solve:
        found = smoother.calculateBestEstimate()
    ms = np.array(updates_s) * 1e3
    fifths = [float(np.median(part)) for part in np.array_split(ms, 5)]
    report = {"build_s": build.wall, "solve_s": solve.wall, "solve_cpu_s": solve.cpu,
              "peak_bytes": peak_bytes(), "updates": len(ms), "update_ms_median": float(np.median(ms)),
              "update_ms_p999": float(np.percentile(ms, 99.9)), "update_ms_median_of_fifths": fifths}
    return ends, found, report, online


def with_unlimited_stack():
    """Restarts this program if the stack is limited and the limit may be raised: a new limit takes effect
    when a program starts."""
    unlimited = resource.RLIM_INFINITY
    soft, hard = resource.getrlimit(resource.RLIMIT_STACK)
    if soft != unlimited and hard == unlimited:
        resource.setrlimit(resource.RLIMIT_STACK, (unlimited, unlimited))
        os.execv(sys.executable, [sys.executable, *sys.argv])


def table(drive, ends, poses):
    t = drive.t0 + np.array(ends) * drive.dt
    p = np.array([pose.translation() for pose in poses])
    q = Rotation.from_matrix(np.array([pose.rotation().matrix() for pose in poses])).as_quat()
    return np.column_stack([t, p, q])


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("case", type=Path)
    arguments.add_argument("solver", choices=["lm", "isam2"])
    arguments.add_argument("nodes", choices=["imu", "prism"])
    arguments.add_argument("--marginals", type=float, default=0.0, metavar="SECONDS")
    arguments.add_argument("--exact-headings", action="store_true")
    given = arguments.parse_args()
    drive = Drive(given.case)
    factors = Factors(drive, given.nodes)
    truth = read(given.case / "truth.csv")
    before = peak_bytes()
    if given.solver == "lm":
        ends, found, report = levenberg_marquardt(factors, given.marginals)
    else:
        ends, found, report, online = isam2(factors)
        report["online"] = errors(truth, table(drive, [i for i, _ in online], [p for _, p in online]))
    report["accuracy"] = errors(truth, table(drive, ends, [found.atPose3(X(i)) for i in ends]))
    if given.exact_headings:
        factors.leaning = lambda i: found.atPose3(X(i)).rotation()
        ends, again, _ = levenberg_marquardt(factors, 0.0)
        report["exact"] = errors(truth, table(drive, ends, [again.atPose3(X(i)) for i in ends]))
    report.update(peak_bytes_before=before, load=os.getloadavg()[0], gtsam=metadata.version("gtsam"))
    print(json.dumps(report))


if __name__ == "__main__":
    with_unlimited_stack()
    main()
