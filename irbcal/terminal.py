"""A terminal that shows what it is given and obeys nothing of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from irbcal.literals import terminal


class Terminal(Console):
    """A console of the package rich: texts have no markup, and what a terminal would obey is shown as an escape."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, highlight=False, emoji=False, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """What is printed, piece by piece; styles and movements are rich's own."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else terminal(text), style, control)
