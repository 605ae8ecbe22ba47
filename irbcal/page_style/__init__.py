"""The look of all pages: colours, the style sheet, and the frame around what a page says.

Reports, certificates, lists of robots, pages of results and views have the same colours and letters; a page adds rules
for what only it has.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from markupsafe import Markup

NOMINAL, CALIBRATED = "#dd7d11", "#1f72bd"
"""The two models; safe for the colour-blind."""

FROM_BELOW, FROM_ABOVE, UNKNOWN = "#1b9e77", "#7b3fa0", "#8a8a8a"
"""Directions from which a joint was reached; the last: not known."""

MEASURED, ACCENT = "#333333", "#7a5195"
"""Measured values, and what is computed from them: neither is a model's colour."""

SERIES = (MEASURED, ACCENT, "#2f8f5b", "#a0527a", "#6b7280")
"""Runs of one kind, in their order."""

TEXT, SOFT, RULE, PAPER = "#1b1f24", "#59636e", "#d5dade", "#ffffff"
"""Words; smaller words and axes; lines of a grid; the ground."""

ERRORS = ("#2166ac", "#2b9c9c", "#d9a400", "#e8590c", "#9e0b26")
"""Sizes of errors, from zero to the top of a scale."""

PAINT = {
    "ink": TEXT,
    "soft": SOFT,
    "line": RULE,
    "page": PAPER,
    "nominal": NOMINAL,
    "calibrated": CALIBRATED,
    "below": FROM_BELOW,
    "above": FROM_ABOVE,
    "accent": ACCENT,
    "measured": MEASURED,
    "unknown": UNKNOWN,
    **{f"error{k}": colour for k, colour in enumerate(ERRORS)},
    **{f"series{k}": colour for k, colour in enumerate(SERIES)},
}
"""Colours of charts by role; on a page they are variables of the style sheet, so that the dark one can have others."""

LIGHT = PAINT | {
    "fill": "#f3f5f7",
    "warn": "#fff1d6",
    "warn-line": "#c77700",
    "state": "#8f5200",
    "proof": "#1b7a3d",
    "bad": "#b3261e",
    "shade": "#0004",
    "action": CALIBRATED,
}
"""Colours by role, of charts and of all else on a page."""

DARK = {
    "page": "#14171b",
    "ink": "#e4e7ea",
    "soft": "#a0a9b3",
    "line": "#363d45",
    "fill": "#1e2329",
    "warn": "#3a2a0c",
    "warn-line": "#dd9a2b",
    "state": "#e6a94a",
    "proof": "#5fc88a",
    "bad": "#ff8a80",
    "shade": "#fff5",
    "action": "#58a6e8",
    "above": "#b58be0",
    "accent": "#b48bd0",
    "measured": "#b9c1c9",
    "series0": "#b9c1c9",
    "series1": "#b48bd0",
    "error0": "#4c92dc",
    "error4": "#e8385a",
}
"""Those which differ on a dark screen."""


def rule(selector: str, scheme: str, colours: Mapping[str, str]) -> str:
    """A rule of a style sheet which gives colours as variables."""
    return f"{selector} {{ color-scheme: {scheme}; {' '.join(f'--{role}: {c};' for role, c in colours.items())} }}\n"


def style() -> Markup:
    """The style sheet of all pages; those of the class ``light`` stay light on a dark screen."""
    from markupsafe import Markup

    dark = rule(":root:not(.light)", "light dark", DARK)
    sheet = Path(__file__).with_name("page.css").read_text(encoding="utf-8")
    return Markup(
        f"{rule(':root', 'light dark', LIGHT)}@media screen and (prefers-color-scheme: dark) {{ {dark}}}\n{sheet}"
    )
