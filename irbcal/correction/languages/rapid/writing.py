"""The text of new numbers in a RAPID module: millimetres, degrees, quaternions, configuration data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.configurations import ConfData
from irbcal.correction.listing import Edit
from irbcal.correction.notation import DECIMALS, QUATERNION_DECIMALS, number_text, numbers_from_poses
from irbcal.correction.text_program import Configuration, Target, TextProgram
from irbcal.errors import ProgramError
from irbcal.units import DEG


def edits(
    program: TextProgram, new_values: Mapping[int, FloatArray], configurations: Mapping[int, Configuration]
) -> list[Edit]:
    """New text of the numbers that change; see `irbcal.correction.text_program.with_targets`."""
    out: list[Edit] = []
    poses = [k for k in new_values if program.targets[k].kind == "pose"]
    if poses:
        near = np.array([program.targets[k].written[3:] for k in poses])
        numbers = numbers_from_poses(np.array([new_values[k] for k in poses]), near)
        for k, row in zip(poses, numbers, strict=True):
            _edit(out, program.targets[k], row, [DECIMALS] * 3 + [QUATERNION_DECIMALS] * 4)
    for k, value in new_values.items():
        if program.targets[k].kind == "joint":
            _edit(out, program.targets[k], np.asarray(value) / DEG, [DECIMALS] * 6)
    for k, conf in configurations.items():
        target = program.targets[k]
        if target.configuration is None:
            message = f"target {target.name} has no configuration in numbers to rewrite"
            raise ProgramError(message, file=program.source, line=target.line)
        assert isinstance(conf, ConfData)
        assert isinstance(target.configuration, ConfData)
        pairs = zip(conf, target.configuration, strict=True)
        spans = target.configuration_spans
        out.extend((*s, str(int(new))) for s, (new, old) in zip(spans, pairs, strict=True) if new != old)
    return out


def _edit(edits: list[Edit], target: Target, numbers: FloatArray, decimals: Sequence[int]) -> None:
    for span, new, old, places in zip(target.spans, numbers, target.written, decimals, strict=True):
        if not abs(new - old) <= 0.5 * 10.0**-places:
            edits.append((*span, number_text(new, places)))
