"""What parameters and terms are called in sentences."""

from __future__ import annotations

import re

from irbcal.units import DEG, MM

DHM = {
    "theta": ("joint {j}'s zero", "a crash, an exchanged motor or a lost zero"),
    "d": ("the length along joint {j}'s axis", "a crash or an exchanged link"),
    "a": ("the length of link {j}", "a crash or an exchanged link"),
    "alpha": ("the tilt between joints {j} and {k}", "a crash or an exchanged bearing"),
    "beta": ("the tilt of joint {j}'s axis", "a crash or an exchanged bearing"),
    "b": ("the offset of joint {j}'s axis", "a crash or an exchanged link"),
}
FAMILIES = (
    ("gravity", "how joint {j} gives way under weight", "a worn or exchanged gear, a bearing, a balancer"),
    ("torque", "how joint {j} gives way under torque", "a worn or exchanged gear"),
    ("direction", "the backlash of joint {j}", "a worn or exchanged gear"),
    ("payload", "how joint {j} gives way under a payload", "a worn or exchanged gear"),
    ("angle", "the gain of joint {j}", "an exchanged gear or resolver"),
    ("sin", "a wave of joint {j}", "an exchanged gear or resolver"),
    ("cos", "a wave of joint {j}", "an exchanged gear or resolver"),
)
UNITS = {"rad": ("degrees", DEG), "m": ("mm", MM)}
_CONSTANT = re.compile(r"delta_([a-z]+)(\d+)")
_TERM = re.compile(r"[a-z]+(\d+)(?:\+\d+)* (\S+)")


HIGHEST = 6
"""Cycles per turn up to which a wave is compared: which higher ones a model has is chance from fit to fit."""
_WAVE = re.compile(r"[a-z]+[0-9+]+ (?:sin|cos) (\d+)(?: \w+)?")


def high_wave(name: str) -> bool:
    """Whether a term is a wave of more than `HIGHEST` cycles per turn."""
    found = _WAVE.fullmatch(name)
    return found is not None and int(found[1]) > HIGHEST


def called(name: str) -> tuple[str, str]:
    """A parameter in words, and what may have changed it."""
    constant = _CONSTANT.fullmatch(name)
    if constant and constant[1] in DHM:
        what, why = DHM[constant[1]]
        joint = int(constant[2])
        return what.format(j=joint, k=joint + 1), why
    term = _TERM.match(name)
    if term:
        for basis, what, why in FAMILIES:
            if term[2].startswith(basis):
                return f"{what.format(j=term[1])} ({name})", why
    return name, "wear, a crash or a repair"


def amount(value: float, std: float, unit: str) -> str:
    """``0.021 ± 0.004 degrees`` of a value in SI units."""
    base, _, per = unit.partition("/")
    shown, factor = UNITS.get(base, (base, 1.0))
    value, std = abs(value) / factor, std / factor
    digits = max(0, 1 - int(f"{std:e}".partition("e")[2])) if std > 0.0 else 6
    tail = f" per {per}" if per else ""
    return f"{value:.{digits}f} ± {std:.{digits}f} {'' if shown == '1' else shown}{tail}".rstrip()
