"""Names of the ways to identify, for the command line and for the functions alike.

The command line reads this file at every start: it imports nothing heavy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from irbcal.errors import OptionError
from irbcal.modeling.levels import LEVELS as LEVELS
from irbcal.modeling.levels import Level as Level
from irbcal.option_values import checked

FitMethod: TypeAlias = Literal["least-squares", "circles", "nelder-mead"]
"""How to identify: Gauss-Newton; directly from the circles of one-joint moves; the search of the thesis."""

Objective: TypeAlias = Literal["rms", "max", "pnorm"]
"""What to minimise: root mean square, largest distance, or a p-norm between them."""

Loss: TypeAlias = Literal["linear", "soft_l1", "huber"]
"""What a distance counts in the root mean square."""

RobustLoss: TypeAlias = Literal["soft_l1", "huber"]

ModelName: TypeAlias = Literal["auto", "best-level", "nominal", "11", "16", "26", "34", "34b", "offsets", "placement"]
"""A level; the average of error models by their evidence (``auto``); or the level that cross-validation chooses."""

Terms: TypeAlias = Literal["joint-map", "all"]
"""What model ``auto`` may consist of: what URDF and a joint map can carry, or frame terms, too."""

Parallel: TypeAlias = Literal["hayati", "forced"]
"""What becomes of nearly parallel axes: the tilt between them is kept, or they get one direction."""

METHODS: tuple[FitMethod, ...] = get_args(FitMethod)
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)
LOSSES: tuple[Loss, ...] = get_args(Loss)
MODELS: tuple[ModelName, ...] = get_args(ModelName)


@dataclass(frozen=True)
class Goal:
    """What a fit makes small."""

    objective: Objective = "rms"
    power: float = 8.0
    """Of a p-norm."""
    loss: Loss = "linear"
    """What a residual counts in the root mean square."""

    def __post_init__(self) -> None:
        checked("objective", self.objective, OBJECTIVES)
        checked("loss", self.loss, LOSSES)
        if self.objective != "rms" and self.loss != "linear":
            raise OptionError(f"loss {self.loss} goes with objective rms, not with {self.objective}", parameter="loss")

    @property
    def least_squares(self) -> bool:
        """Whether it is the sum of squares."""
        return self.objective == "rms" and self.loss == "linear"


LEAST_SQUARES = Goal()
