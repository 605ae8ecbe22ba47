"""Names of the ways to identify, for the command line and for `irbcal.identification.methods` alike."""

from typing import Literal, TypeAlias, get_args

Method: TypeAlias = Literal["least-squares", "axes", "nelder-mead"]
Objective: TypeAlias = Literal["rms", "max", "pnorm"]
Loss: TypeAlias = Literal["linear", "soft_l1", "huber"]

METHODS: tuple[str, ...] = get_args(Method)
OBJECTIVES: tuple[str, ...] = get_args(Objective)
LOSSES: tuple[str, ...] = get_args(Loss)
