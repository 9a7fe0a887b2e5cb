"""Two epochs compared with py4dgeo: `python py4dgeo_script.py`."""

from pathlib import Path

import numpy as np
import py4dgeo

DATA = Path(__file__).parents[2] / "tests" / "data" / "m3c2_case"

epoch1 = py4dgeo.Epoch(np.load(DATA / "epoch1.npy"))
epoch2 = py4dgeo.Epoch(np.load(DATA / "epoch2.npy"))
corepoints = np.load(DATA / "corepoints.npy")

m3c2 = py4dgeo.M3C2(
    epochs=(epoch1, epoch2),
    corepoints=corepoints,
    cyl_radius=0.02,
    normal_radii=(0.03, 0.06),
    max_distance=0.05,
    registration_error=0.001,
)
distances, uncertainties = m3c2.run()
