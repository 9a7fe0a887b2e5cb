"""Runs one peer on one case, timed from arrays in memory to results in memory; prints one JSON line.

usage: with_peer.py PEER CASE THREADS FILE... [--radius M] [--save FILE]

The times include the peers' search structures, which are listed separately if the peer allows it. The
number of threads is set by the peer's own parameter, or by OMP_NUM_THREADS, which must be in the
environment, or, for pgeof, which uses all processors, by the processors that this process may use.
"""

import argparse
import hashlib
import json
import os
import time
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

import numpy as np

NEIGHBOURS = 50
VOXEL_M = 0.005
CYLINDER_RADIUS_M, MAX_DISTANCE_M, NORMAL_RADII_M = 0.02, 0.05, [0.03, 0.06]


class Clock:
    """Wall and processor seconds of each part of the work."""

    def __init__(self):
        self.parts, self.seconds, self.cpu_s = {}, 0.0, 0.0

    @contextmanager
    def __call__(self, part):
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        seconds = time.perf_counter() - wall
        self.parts[part] = self.parts.get(part, 0.0) + seconds
        self.seconds += seconds
        self.cpu_s += time.process_time() - cpu


def cube_root_of_determinant(c):
    """Omnivariances of symmetric 3 x 3 matrices; several times faster than numpy.linalg.det."""
    a, b, d = c[:, 0, 0], c[:, 0, 1], c[:, 0, 2]
    e, f, g = c[:, 1, 1], c[:, 1, 2], c[:, 2, 2]
    return np.cbrt(a * (e * g - f * f) - b * (b * g - d * f) + d * (b * f - d * e))


def features_open3d(clock, points, given):
    """Covariances by estimate_covariances, divided by n; the determinant by numpy."""
    import open3d as o3d

    with clock("copying in"):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    with clock("search and covariances"):
        cloud.estimate_covariances(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    with clock("omnivariance"):
        return cube_root_of_determinant(np.asarray(cloud.covariances))


def features_small_gicp(clock, points, given):
    """Covariances only, whose eigenvalues small_gicp replaces by (0.001, 1, 1): omnivariance cannot be
    computed from them, and the time is less than that of the full task."""
    import small_gicp

    with clock("copying in"):
        cloud = small_gicp.PointCloud(points)
    with clock("index"):
        tree = small_gicp.KdTree(cloud, num_threads=given.threads)
    with clock("search and covariances"):
        small_gicp.estimate_covariances(cloud, tree, NEIGHBOURS, given.threads)
    return None


def features_jakteristics(clock, points, given):
    """Neighbours within a radius that contains 50 in the median, as jakteristics has no search for the k nearest."""
    import jakteristics

    with clock("index"):
        tree = jakteristics.cKDTree(points)
    with clock("search and omnivariance"):
        return jakteristics.compute_features(points, given.radius, kdtree=tree, num_threads=given.threads,
                                             feature_names=["omnivariance"])[:, 0]


def features_pgeof(clock, points, given):
    """knn_search and compute_features, which computes all eleven features in single precision; pgeof's volume is
    the cube root of the product of standard deviations, so omnivariance is its square."""
    import pgeof

    with clock("copying in"):
        single = points.astype(np.float32)
    with clock("index and search"):
        neighbours, _ = pgeof.knn_search(single, single, NEIGHBOURS)
    with clock("features"):
        starts = np.arange(len(points) + 1, dtype=np.uint32) * np.uint32(NEIGHBOURS)
        return pgeof.compute_features(single, neighbours.reshape(-1), starts)[:, 9] ** 2


def thin_small_gicp(clock, points, given):
    import small_gicp

    with clock("thinning"):
        thinned = small_gicp.voxelgrid_sampling(points, VOXEL_M, given.threads)
    return thinned.points()[:, :3]


def thin_open3d(clock, points, given):
    """The classes of open3d.geometry, which always use one thread."""
    import open3d as o3d

    with clock("copying in"):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    with clock("thinning"):
        return np.asarray(cloud.voxel_down_sample(VOXEL_M).points)


def thin_open3d_t(clock, points, given):
    """The classes of open3d.t.geometry."""
    import open3d as o3d

    with clock("copying in"):
        cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor.from_numpy(points))
    with clock("thinning"):
        return cloud.voxel_down_sample(VOXEL_M).point.positions.numpy()


def m3c2_py4dgeo(clock, files, given, tree):
    import py4dgeo

    py4dgeo.Epoch.set_default_radius_search_tree(tree)
    py4dgeo.set_num_threads(given.threads)
    first, second, core = files
    with clock("copying in"):
        epochs = py4dgeo.Epoch(first), py4dgeo.Epoch(second)
    with clock("index"):
        for epoch in epochs:
            epoch.build_octree() if tree == "octree" else epoch.build_kdtree()
    algorithm = py4dgeo.M3C2(epochs=epochs, corepoints=core, normal_radii=NORMAL_RADII_M,
                             cyl_radius=CYLINDER_RADIUS_M, max_distance=MAX_DISTANCE_M)
    with clock("normals"):
        normals = algorithm.directions()
    with clock("distances"):
        distances, uncertainties = algorithm.run()
    return {"distance": distances, "normals": normals, "uncertainties": uncertainties}


RUNS = {
    ("open3d", "features"): features_open3d,
    ("small_gicp", "features"): features_small_gicp,
    ("jakteristics", "features"): features_jakteristics,
    ("pgeof", "features"): features_pgeof,
    ("small_gicp", "thin"): thin_small_gicp,
    ("open3d", "thin"): thin_open3d,
    ("open3d.t", "thin"): thin_open3d_t,
    ("py4dgeo octree", "m3c2"): lambda *given: m3c2_py4dgeo(*given, "octree"),
    ("py4dgeo k-d tree", "m3c2"): lambda *given: m3c2_py4dgeo(*given, "kdtree"),
}


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("peer")
    arguments.add_argument("case")
    arguments.add_argument("threads", type=int)
    arguments.add_argument("files", type=Path, nargs="+")
    arguments.add_argument("--radius", type=float, metavar="M")
    arguments.add_argument("--save", type=Path, metavar="FILE")
    given = arguments.parse_args()
    if given.peer == "pgeof":
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: given.threads])
    data = [np.load(path) for path in given.files]
    clock = Clock()
    result = RUNS[given.peer, given.case](clock, data if given.case == "m3c2" else data[0], given)
    report = {"seconds": clock.seconds, "cpu_s": clock.cpu_s, "parts": clock.parts}
    if given.case == "thin":
        report["points"] = len(result)
        report["sha256"] = hashlib.sha256(np.ascontiguousarray(result).tobytes()).hexdigest()
    if given.save and result is not None:
        np.savez(given.save, **(result if isinstance(result, dict) else {"result": result}))
    package = given.peer.split()[0].split(".")[0]
    print(json.dumps({**report, "version": f"{package} {metadata.version(package)}"}))


if __name__ == "__main__":
    main()
