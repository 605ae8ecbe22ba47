"""SIMULATED contacts with four balls of a robot whose joints give way under a payload."""

import numpy as np
import pandas as pd

from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.simulation.devices import DEVICES, placed, poses, rows_table, touched_poses

GIVE = np.array([0.0, 1.5e-6, 2e-6, 0.0, 5e-6, 0.0])
"""rad/(N m) of each joint."""

PLACE = (0.0, 0.03, 0.1)
LOADS = (0.0, 8.0)


def map_of(arm):
    return TermMap(arm, tuple(Payload(PLACE).terms(arm)), GIVE)


def contacts(nominal, truth, count=50, noise=1e-5, seed=0):
    """Rows (n for each load) and the features' table."""
    found = placed(nominal, DEVICES["balls"])
    rng, parts = np.random.default_rng(seed), []
    terms = map_of(nominal)
    for load in LOADS:
        q, which = poses(nominal, found, count, seed + int(load))
        for k, name in enumerate(found.unknowns):
            mine = which == k
            off = noise * rng.standard_normal((int(mine.sum()), 3))

            def tips(q, load=load):
                return terms.forward(truth, Motion(q, inputs={"payload_kg": np.full(len(q), load)}))

            q[mine], good = touched_poses(nominal, found, name, q[mine], tips, off)
            assert good.all()
        table = rows_table(nominal, found, q, which, None)
        table["pose"] = [f"{load:g}/{k}" for k in table["pose"]]
        place = dict(zip(("payload_x_mm", "payload_y_mm", "payload_z_mm"), 1e3 * np.array(PLACE), strict=True))
        parts.append(table.assign(payload_kg=load, **place, simulated="yes"))
    return pd.concat(parts, ignore_index=True), found.table()
