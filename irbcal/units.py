"""The only conversion factors of the project: millimetres and degrees outside, metres and radians inside."""

import numpy as np

MM = 1e-3
"""One millimetre in metres."""

DEG = np.pi / 180.0
"""One degree in radians."""

UNIT_OUTSIDE = {"m": ("mm", MM), "rad": ("deg", DEG), "1": ("1", 1.0)}
"""SI unit -> (unit at the surface, factor: value in SI = factor * value at the surface)."""
