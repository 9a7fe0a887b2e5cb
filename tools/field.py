#!/usr/bin/env python3
"""Predicted standard deviations of the mountings for layouts of a field: the table of docs/field.md.

    python3 tools/field.py [--write] [NAME…]

Each layout is a scenario that `boresight simulate` drives and `boresight run` calibrates. BORESIGHT names the
program; the default is target/release/boresight. Change LAYOUTS to your own boards and passes.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "field.md"
MARKS = "<!-- layouts: begin -->\n", "<!-- layouts: end -->\n"

# East and north of the centre of each board, its tilt and the azimuth of its normal, as in the demo.
BOARDS = [(1.6, 1.4, 30, 70), (5.9, 1.4, 15, 310), (3.75, 3.0, 0, 0), (1.6, 4.6, 45, 160), (5.9, 4.6, 55, 250)]
# Board and heading of the passes of one round over all boards: to the east and west, and so on.
ROUNDS = [
    [(0, 90), (1, 90), (4, 270), (3, 270), (2, 90)],
    [(1, 0), (4, 0), (3, 180), (0, 180), (2, 0)],
    [(1, 270), (0, 270), (3, 90), (4, 90), (2, 270)],
    [(0, 0), (3, 0), (4, 180), (1, 180), (2, 180)],
]
CROSSED = [0, 1]


def layout(boards=(0, 1, 2, 3, 4), rounds=CROSSED, tilt=None, keys="", reference=True, heading=True):
    return {"boards": boards, "rounds": rounds, "tilt": tilt, "keys": keys, "reference": reference, "heading": heading}


LAYOUTS = {
    "5 boards of 0 to 55°, each passed twice, crossing": layout(),
    "no board, the same lines over soil": layout(boards=()),
    "1 board of 45°": layout(boards=(3,)),
    "1 board of 45°, passed eight times": layout(boards=(3,), rounds=[0, 1, 2, 3] * 2),
    "2 boards of 45° and 30°": layout(boards=(0, 3)),
    "3 boards of 45°, 30° and 55°": layout(boards=(0, 3, 4)),
    "5 boards, all level": layout(tilt=0),
    "5 boards, all of 15°": layout(tilt=15),
    "5 boards, all of 30°": layout(tilt=30),
    "5 boards, each passed once": layout(rounds=[0]),
    "5 boards, each passed twice, there and back": layout(rounds=[0, 2]),
    "prism of 2 mm": layout(keys="[prism]\nsigma_m = 0.002\n"),
    "prism of 10 mm": layout(keys="[prism]\nsigma_m = 0.01\n"),
    "no headings": layout(heading=False),
    "without the reference": layout(reference=False),
    "no board, without the reference": layout(boards=(), reference=False),
}


def scenario(chosen):
    text = f'name = "layout"\n{chosen["keys"]}'
    if not chosen["boards"]:
        text += "boards = []\n" if not chosen["keys"] else ""
    numbers = {}
    for number in chosen["boards"]:
        east, north, tilt, azimuth = BOARDS[number]
        tilt = tilt if chosen["tilt"] is None else chosen["tilt"]
        numbers[number] = len(numbers)
        text += f"[[boards]]\ncenter_m = [{east}, {north}, 0.5]\ntilt_deg = {tilt}\nazimuth_deg = {azimuth}\nsize_m = [1.0, 1.0]\n"
    text += "[[drives]]\n"
    for number, heading in (each for one in chosen["rounds"] for each in ROUNDS[one]):
        if not chosen["boards"]:
            east, north = BOARDS[number][:2]
            ahead = [0.6 * math.sin(math.radians(heading)), 0.6 * math.cos(math.radians(heading))]
            line = [[round(place + sign * step, 3) for place, step in zip((east, north), ahead)] for sign in (-1, 1)]
            text += f"[[drives.passes]]\nfrom_m = {line[0]}\nto_m = {line[1]}\n"
        elif number in numbers:
            text += f"[[drives.passes]]\nboard = {numbers[number]}\nheading_deg = {heading}.0\n"
    return text


def without(project, name):
    """The project without the table `name`."""
    begin = project.index(f"[{name}]\n")
    end = project.find("\n[", begin)
    return project[:begin] + (project[end + 1 :] if end >= 0 else "")


def product(a, b):
    """The product of two quaternions x, y, z, w."""
    (x, y, z, w), (p, q, r, s) = a, b
    return [w * p + x * s + y * r - z * q, w * q - x * r + y * s + z * p, w * r + x * q - y * p + z * s, w * s - x * p - y * q - z * r]


def rotation(angles_deg):
    """The quaternion of angles in the convention `bonn`."""
    whole = [0, 0, 0, 1]
    for axis in (2, 1, 0):
        half = math.radians(angles_deg[axis]) / 2
        one = [0, 0, 0, math.cos(half)]
        one[axis] = math.sin(half)
        whole = product(whole, one)
    return [-whole[0], -whole[1], -whole[2], whole[3]]


def errors(mounting, truth):
    """The errors of a mounting, in metres and in degrees about the axes of the body."""
    q = rotation(truth["rotation_deg"])
    off = product(mounting["quaternion_xyzw"], [-q[0], -q[1], -q[2], q[3]])
    sign = math.copysign(1, off[3])
    return [a - b for a, b in zip(mounting["translation_m"], truth["translation_m"])] + [math.degrees(2 * sign * x) for x in off[:3]]


def row(name, chosen, folder):
    program = os.environ.get("BORESIGHT", ROOT / "target" / "release" / "boresight")

    def boresight(*words):
        command = [program, "--quiet", *words]
        return subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout

    (folder / "scenario.toml").write_text(scenario(chosen))
    boresight("simulate", "--scenario", folder / "scenario.toml", "--out", folder / "data")
    drive = folder / "data" / "drive-1"
    path = drive / "project.toml"
    # The table shows the layout alone: assumed uncertainties of the reference add to any layout.
    project = path.read_text().replace('file = "../tls.laz"\n', 'file = "../tls.laz"\nsigma_m = 0.0\nsigma_deg = 0.0\n')
    for table in ("reference", "heading"):
        if not chosen[table]:
            project = without(project, table)
    path.write_text(project)
    boresight("run", path, "--out", folder / "out")
    result = json.loads((folder / "out" / "result.json").read_text())
    assert result["calibration"]["method"] == "joint", f"{name}: the joint adjustment was refused"
    truth = tomllib.loads((drive / "truth" / "mounting.toml").read_text())
    truth = {each["name"]: each for each in truth["scanner"]}
    sigmas, normalised = [], []
    for scanner, calibrated in result["scanners"].items():
        sigma = calibrated["sigma"]["translation_m"] + calibrated["sigma"]["rotation_deg"]
        sigmas.append(sigma)
        off = errors(calibrated["body_from_scanner"], truth[scanner])
        normalised += [error / sigma for error, sigma in zip(off, sigma) if sigma]
    worst = [max((sigma for sigma in each if sigma is not None), default=math.nan) for each in zip(*sigmas)]
    poses = (drive / "prism.csv").read_text().splitlines()
    minutes = (float(poses[-1].split(",")[0]) - float(poses[1].split(",")[0])) / 60
    numbers = [f"{minutes:.1f}"] + [f"{1e3 * x:.2f}" for x in worst[:3]] + [f"{x:.3f}" for x in worst[3:]]
    size = math.sqrt(sum(x * x for x in normalised) / len(normalised))
    return f"| {name} | {' | '.join(numbers)} | {size:.1f} |\n"


def main():
    names = [word for word in sys.argv[1:] if word != "--write"] or list(LAYOUTS)
    table = "| layout | minutes | tx mm | ty mm | tz mm | rx ° | ry ° | rz ° | errors in sigmas |\n"
    table += "|---|---:|---:|---:|---:|---:|---:|---:|---:|\n"
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            one = row(name, LAYOUTS[name], Path(folder))
        print(one, end="", flush=True)
        table += one
    if "--write" in sys.argv[1:]:
        text = PAGE.read_text()
        begin, end = text.index(MARKS[0]) + len(MARKS[0]), text.index(MARKS[1])
        PAGE.write_text(f"{text[:begin]}\n{table}\n{text[end:]}")


if __name__ == "__main__":
    main()
