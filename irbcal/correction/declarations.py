"""Tools and work objects of a cell as a maker's controller declares them, in a text to load or to type in.

KUKA, ABB, Kawasaki, Staubli and Universal Robots have files with such declarations, which are read here, too. FANUC
keeps them in a binary file: a listing sets them when it runs. Yaskawa's files have the loads of all tools, too, which
are not known here: theirs is a list for the pendant.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import languages
from irbcal.correction.maker import Maker
from irbcal.errors import OptionError


def numbers(maker: Maker, T: FloatArray) -> list[float]:
    """Numbers of a frame (4, 4) as a maker writes them: mm or m, angles or quaternion."""
    return [float(number) for number in maker.numbers(T[None], np.zeros((1, 3 + len(maker.orientation.names))))[0]]


def declared(
    name: str,
    tools: Mapping[str, FloatArray],
    work_objects: Mapping[str, FloatArray],
    with_fixed_tool: Collection[str] = (),
) -> str:
    """Declarations of tools and work objects.

    Parameters
    ----------
    name : str
        Of the maker.
    tools, work_objects : dict of str to ndarray, shape (4, 4)
        In the controller's flange and base, metres.
    with_fixed_tool : collection of str, optional
        Names of those that are parts that the robot holds, and fixed tools.

    Raises
    ------
    OptionError
        If a name is none that the maker allows, or how the maker has fixed tools is not known.
    """
    language = languages.of_maker(name)
    form, maker = language.declaration, language.maker
    assert form is not None
    assert maker is not None
    lines = [form.head]
    for named, usual, other in (
        (tools, ("tool", form.tool), ("held part", form.held_part)),
        (work_objects, ("work object", form.work_object), ("fixed tool", form.fixed_tool)),
    ):
        for key, T in named.items():
            title, line = other if key in with_fixed_tool else usual
            if not line:
                raise OptionError(f"{title} {key}: how {name} has fixed tools is not known", parameter="declare")
            if not re.fullmatch(form.name, key, re.ASCII):
                message = f"{title} {key}: names of {name} {form.names}; name it so in the touches"
                raise OptionError(message, parameter="declare")
            position, angle, _ = maker.decimals
            texts = [
                f"{number:.{position if k < 3 else angle}f}" for k, number in enumerate(np.add(numbers(maker, T), 0.0))
            ]
            texts = [form.negative.format(text) if text.startswith("-") else text for text in texts]
            lines.append(line.format(*texts, name=key, base=key.partition("[")[0]))
    return form.as_file(lines) if form.as_file else "\n".join([*lines, *filter(None, [form.foot]), ""])
