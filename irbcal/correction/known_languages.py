"""The robot languages that are known, a line each; light, since the command line's help lists them.

What each is stands in its file in `irbcal.correction.languages`, as its `irbcal.correction.language.Language`.
"""

from __future__ import annotations

from typing import NamedTuple


class KnownLanguage(NamedTuple):
    """A language that is looked for."""

    name: str
    """Short name: of its file, and for ``irbcal plan --language``."""
    maker: str = ""
    """Short name of the maker whose controllers declare frames in it; empty where there is no such declaration."""
    plans: bool = True
    """Whether ``irbcal plan --language`` takes it."""


KNOWN = (
    KnownLanguage("rapid", "abb"),
    KnownLanguage("krl", "kuka"),
    KnownLanguage("fanuc", "fanuc"),
    KnownLanguage("inform", "yaskawa"),
    KnownLanguage("kawasaki", "kawasaki"),
    KnownLanguage("urscript", "ur"),
    KnownLanguage("val3", "staubli"),
    KnownLanguage("ros", plans=False),
    KnownLanguage("table"),
)
"""In the order in which they are tried."""

SHORT = {"table": "csv"}
"""Names of languages that are not called as their files."""

MAKERS = tuple(language.maker for language in KNOWN if language.maker)
PLANNED = tuple(SHORT.get(language.name, language.name) for language in KNOWN if language.plans)
