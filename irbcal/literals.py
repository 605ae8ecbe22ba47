"""Data in generated text: for each language, what makes a value a literal that is there, and can do nothing else.

Names in a robot's URDF, in measurements and in calibrations are anybody's. Templates of `irbcal.templates` apply the
literal of their language to all that they are given; what is a piece of that language already is `markupsafe.Markup`,
as `word` and `comment` make it. Comments of robot programs and cells of tables: `irbcal.names`.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.errors import escaped

if TYPE_CHECKING:
    from markupsafe import Markup


def python(value: Any) -> str:
    """Numbers, texts, None, and lists and dicts of them as Python writes them; ``nan`` and ``inf`` are names."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{python(key)}: {python(element)}" for key, element in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(python(element) for element in value) + "]"
    if isinstance(value, np.generic):
        value = value.item()
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind.__repr__(value)
    if value is None:
        return "None"
    raise TypeError(f"no literal of Python: {type(value).__name__}")


def cpp(value: Any) -> str:
    """Numbers, truth values, texts and lists of them as C++ writes them; ``data::nan`` and ``data::inf`` are names."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        if np.isnan(value):
            return "data::nan"
        if np.isinf(value):
            return "data::inf" if value > 0 else "-data::inf"
        return repr(float(value))
    if isinstance(value, str):
        plain = (chr(byte) if 32 <= byte < 127 and byte not in b'"\\?' else f"\\{byte:03o}" for byte in value.encode())
        return f'"{"".join(plain)}"'
    if isinstance(value, (list, tuple, np.ndarray)):
        return "{" + ", ".join(cpp(element) for element in value) + "}"
    raise TypeError(f"no literal of C++: {type(value).__name__}")


def shell(*words: str, windows: bool = os.name == "nt") -> str:
    """Words of a command line as a shell takes them: that of POSIX, or cmd and PowerShell on Windows."""
    if not windows:
        return shlex.join(words)
    return " ".join(
        word if re.fullmatch(r"[\w.:\\/=+@-]+", word) else '"' + word.replace('"', '""') + '"' for word in words
    )


def word(text: str) -> Markup:
    """A name of the language itself: of a variable, a namespace, a file.

    Raises
    ------
    ValueError
        If it is none.
    """
    from markupsafe import Markup

    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.]*", text):
        raise ValueError(f"expected a name of letters and digits, found {text!r}")
    return Markup(text)


def one_line(text: str) -> str:
    """A text on one line, without characters that a terminal obeys."""
    return " ".join("".join(char if char.isprintable() else " " for char in text).split())


def comment(text: str) -> Markup:
    """A text inside a comment of Python, C or C++, to the end of a line or not: nothing in it can end that."""
    from markupsafe import Markup

    return Markup(one_line(text).replace("\\", "/").replace("*/", "* /"))


def xml_comment(text: str) -> str:
    """A text inside a comment of XML: hyphens do not meet."""
    return f" {re.sub('-(?=-)', '- ', one_line(text))} "


def xacro(text: str) -> str:
    """A text inside XML that xacro reads: it computes nothing of it."""
    return text.replace("$", "$$")


def terminal(text: str) -> str:
    """A text as a terminal may be given it: what it would obey is shown as an escape; line ends stay."""
    return text if text.isprintable() else escaped(text, "\n\u00a0")
