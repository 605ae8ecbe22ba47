"""Text of exports from templates: numbers as they are, to the last digit."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.exporting.parts import Parts, Vectors

if TYPE_CHECKING:
    from jinja2 import Environment


def cpp(value: Any) -> str:
    """Numbers, truth values and arrays of them as C++ writes them."""
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
    return "{" + ", ".join(cpp(item) for item in value) + "}"


def line(text: str) -> str:
    """A text inside a docstring or a comment: what would end that is left out."""
    return (
        " ".join("".join(char if char.isprintable() else " " for char in text).split())
        .replace("\\", "/")
        .replace('"', "'")
    )


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("irbcal.exporting"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"num": cpp, "py": repr, "line": line}
    return environment


def render(template: str, parts: Parts, vectors: Vectors, **more: Any) -> bytes:
    """A file of an export.

    Parameters
    ----------
    template : str
        In the folder ``templates``.
    parts : Parts
    vectors : Vectors
    **more
        What else the template names.

    Returns
    -------
    bytes
        UTF-8.
    """
    text = _environment().get_template(template).render(parts=parts, vectors=vectors, n=len(parts.joint_names), **more)
    return text.encode("utf-8")
