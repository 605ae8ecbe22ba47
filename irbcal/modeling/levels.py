"""Names of the levels of the error model (Nubiola 2011, section 5.4); the command line reads them at every start."""

from typing import Literal, TypeAlias, get_args

Level: TypeAlias = Literal["nominal", "11", "16", "26", "34", "34b", "offsets", "placement"]
"""Error models, see `irbcal.modeling.parameters`."""

LEVELS: tuple[Level, ...] = get_args(Level)
"""All levels."""
