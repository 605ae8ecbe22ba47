"""Text of exports from templates: what is put into them is a literal of their language."""

from __future__ import annotations

from typing import Any

from irbcal import literals
from irbcal.exporting.parts import Parts, Vectors

LANGUAGES = {"py": literals.python, "hpp": literals.cpp, "cpp": literals.cpp}
"""By the ending of a template's name, before ``.j2``."""


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
    from irbcal.templates import environment as templates

    environment = templates("irbcal.exporting", literal=LANGUAGES[template.split(".")[-2]])
    environment.filters |= {"comment": literals.comment, "word": literals.word}
    text = environment.get_template(template).render(parts=parts, vectors=vectors, n=len(parts.joint_names), **more)
    return text.encode("utf-8")
