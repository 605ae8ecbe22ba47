"""Where Nubiola 2011 measured: the ISO cube of the IRB 1600 and the heights of the cell (section 7.2, Table A I-1)."""

import numpy as np

from irbcal.arrays import FloatArray, locked
from irbcal.units import DEG, MM

IRB1600_CUBE: tuple[FloatArray, float] = (locked(np.array([645.6547, 0.0, 1165.707]) * MM), 650 * MM)
"""Centre in the base link and edge of the ISO cube of the IRB 1600 (Nubiola 2011, section 7.2, Table A I-1), metres."""

IRB1600_P1: FloatArray = locked(np.array([[0.0, -14.0, 14.0, 0.0, 0.0, 0.0]]) * DEG)
"""Joints that bring its tip to the centre of that cube (Nubiola 2011, Table A I-1), radians."""

IRB1600_HEIGHTS: tuple[float, float] = (700 * MM, 1100 * MM)
"""Obstacle limits of Nubiola 2011, section 7.2, in front and at the back, metres."""

FRONT: float = 150 * MM
"""Where the front begins along x of the base link, metres."""
