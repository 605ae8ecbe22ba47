"""Tools and work objects of a cell as a maker's controller declares them, in a text to load or to type in.

KUKA, ABB, Kawasaki, Staubli and Universal Robots have files with such declarations, which are read here, too. FANUC
keeps them in a binary file: a listing sets them when it runs. Yaskawa's files have the loads of all tools, too, which
are not known here: theirs is a list for the pendant.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import languages
from irbcal.correction.languages import fanuc, rapid
from irbcal.correction.maker import Maker
from irbcal.errors import OptionError


class Declaration(NamedTuple):
    """How a maker declares frames."""

    language: str
    """Of `irbcal.correction.languages`."""
    name: str
    names: str
    """Pattern of the names that it allows, and the same in words."""
    head: str
    tool: str
    work_object: str
    foot: str = ""
    """Lines; those of frames with their ``{name}``, its ``{base}`` without index, and numbers ``{0}`` …"""
    held_part: str = ""
    fixed_tool: str = ""
    """Likewise of a part that the robot holds, in the flange, and of the tool that works on it; empty where how the
    maker has them is not known.
    """


_WORD = r"[A-Za-z_]\w{0,31}"
_LETTERS = "begin with a letter and have letters, digits and _ only"
_NUMBERED = r"[1-9]\d?"
_POSE = "[[{0},{1},{2}],[{3},{4},{5},{6}]]"
_VALUE = 'x="{0}" y="{1}" z="{2}" rx="{3}" ry="{4}" rz="{5}"'
_REGISTER = "".join(f"PR[100,{k + 1}]={{{k}}}\n" for k in range(6))
"""By way of the last position register that every controller has; ``PR[100]=LPOS`` before makes it Cartesian."""

DECLARATIONS = {
    "kuka": Declaration(
        "krl",
        _NUMBERED,
        "are numbers from 1 to 99",
        "DEFDAT $CONFIG",
        "TOOL_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        "BASE_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        "ENDDAT",
        "TOOL_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        "BASE_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
    ),
    "abb": Declaration(
        "rapid",
        _WORD,
        _LETTERS,
        "MODULE irbcal_cell\n  ! The loads of tools are not known here: set them in place of mass -1",
        f"  PERS tooldata {{name}}:=[TRUE,{_POSE},[-1,[0,0,0],[1,0,0,0],0,0,0]];",
        f'  PERS wobjdata {{name}}:=[FALSE,TRUE,"",{_POSE},[[0,0,0],[1,0,0,0]]];',
        "ENDMODULE",
        f'  PERS wobjdata {{name}}:=[TRUE,TRUE,"",{_POSE},[[0,0,0],[1,0,0,0]]];',
        f"  PERS tooldata {{name}}:=[FALSE,{_POSE},[-1,[0,0,0],[1,0,0,0],0,0,0]];",
    ),
    "fanuc": Declaration(
        "fanuc",
        _NUMBERED,
        "are numbers from 1 to 99",
        "!Overwrites PR[100]\nPR[100]=LPOS",
        f"{_REGISTER}UTOOL[{{name}}]=PR[100]",
        f"{_REGISTER}UFRAME[{{name}}]=PR[100]",
    ),
    "yaskawa": Declaration(
        "inform",
        _NUMBERED,
        "are numbers from 1 to 99",
        "To type in: ROBOT, TOOL and ROBOT, USER COORD (mm, degrees)",
        "TOOL {name}  X {0}  Y {1}  Z {2}  Rx {3}  Ry {4}  Rz {5}",
        "USER {name}  X {0}  Y {1}  Z {2}  Rx {3}  Ry {4}  Rz {5}",
    ),
    "kawasaki": Declaration(
        "kawasaki",
        r"[A-Za-z][A-Za-z0-9_.]{0,14}",
        "begin with a letter and have at most 15 letters, digits, _ and .",
        ".TRANS",
        "{name} {0} {1} {2} {3} {4} {5}",
        "{name} {0} {1} {2} {3} {4} {5}",
        ".END",
    ),
    "staubli": Declaration(
        "val3",
        rf"{_WORD}\[0\]",
        "are those of elements, such as tGrip[0]",
        '<?xml version="1.0" encoding="utf-8" ?>\n<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xmlns="http://www.staubli.com/robotics/VAL3/Data/2">\n  <Datas>',
        '    <Data name="{base}" access="public" xsi:type="array" type="tool" size="1">\n'
        f'      <Value key="0" {_VALUE} fatherId="flange[0]" />\n    </Data>',
        '    <Data name="{base}" access="public" xsi:type="array" type="frame" size="1">\n'
        f'      <Value key="0" {_VALUE} fatherId="world[0]" />\n    </Data>',
        "  </Datas>\n</Database>",
    ),
    "ur": Declaration(
        "urscript",
        _WORD,
        _LETTERS,
        "# Tools are set as TCP where the program uses them, frames are for pose_trans",
        "set_tcp(p[{0},{1},{2},{3},{4},{5}])  # {name}",
        "{name} = p[{0},{1},{2},{3},{4},{5}]",
    ),
}
"""By the names of makers."""


def maker_of(name: str) -> Maker:
    """How a maker writes numbers, by its name in `DECLARATIONS`."""
    return languages.by_name()[DECLARATIONS[name].language].MAKER or rapid.ABB


def numbers(maker: Maker, T: FloatArray) -> list[float]:
    """Numbers of a frame (4, 4) as a maker writes them: mm or m, angles or quaternion."""
    return [float(number) for number in maker.numbers(T[None], np.zeros((1, 7 if maker is rapid.ABB else 6)))[0]]


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
    form, maker = DECLARATIONS[name], maker_of(name)
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
            if maker is fanuc.FANUC:
                texts = [f"({text})" if text.startswith("-") else text for text in texts]
            lines.append(line.format(*texts, name=key, base=key.partition("[")[0]))
    if maker is fanuc.FANUC:
        return fanuc.listing_of("IRBCAL_CELL", "irbcal cell", "\n".join(lines).split("\n"))
    return "\n".join([*lines, *filter(None, [form.foot]), ""])
