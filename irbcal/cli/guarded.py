"""Commands that never write over what they read, and whose help breaks no word."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperCommand

from irbcal.cli.signature import EXPERT, HELP_ALL_KEY
from irbcal.overwriting import refuse_overwriting

OUTPUTS = ("out", "changes", "html", "plot", "plots", "figures", "data", "report", "csv", "latex")
"""Parameters that name files or folders to write, of every command: all others that name files are read."""
INTERRUPTED = 130
"""Exit code, as shells have it."""


class Guarded(TyperCommand):
    """A command that compares its outputs with its inputs before it does anything."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Help whose lists of choices have places to break a line at; options for experts on request only."""
        params: list[Any] = self.get_params(ctx)
        for param in params:
            kind = getattr(param, "type_descriptor", None)
            if getattr(param, "is_flag", False):
                param.metavar = ""
            elif kind is not None and kind.is_choice and param.metavar is None:
                param.metavar = f"<{' | '.join(str(getattr(choice, 'value', choice)) for choice in kind.choices)}>"
            if getattr(param, "rich_help_panel", None) == EXPERT:
                param.hidden = HELP_ALL_KEY not in ctx.meta
        super().format_help(ctx, formatter)

    def invoke(self, ctx: Any) -> Any:
        """Run the command, unless an output is an input or another output; say where it goes on if it is stopped."""
        outputs = {name: value for name, value in ctx.params.items() if name in OUTPUTS}
        refuse_overwriting(outputs, *(value for name, value in ctx.params.items() if name not in OUTPUTS))
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stopped:
            from irbcal.parallel import Interrupted

            if not isinstance(stopped, Interrupted):
                raise
            typer.echo(f"irbcal: {stopped}", err=True)
            raise typer.Exit(INTERRUPTED) from None
