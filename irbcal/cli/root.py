"""The command that all others belong to, and completion for a shell that is named or found."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperGroup

NAME = "irbcal"
SHELLS = ("bash", "zsh", "fish", "powershell", "pwsh")
OPTIONS = ("--show-completion", "--install-completion")


class Root(TyperGroup):
    """A group whose options for completion take the shell's name, too: ``irbcal --show-completion bash``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Serve completion for a named shell; everything else as ever."""
        if args and args[0] in OPTIONS:
            _complete(args[0], args[1] if len(args) > 1 else None)
        return super().parse_args(ctx, args)


def _complete(option: str, shell: str | None) -> None:
    from typer._completion_shared import _get_shell_name, get_completion_script, install

    shell = _get_shell_name() if shell is None else shell
    if shell not in SHELLS:
        shell_text = "found none" if shell is None else f"found {shell!r}"
        raise typer.BadParameter(f"expected a shell ({', '.join(SHELLS)}), {shell_text}", param_hint=option)
    variable = f"_{NAME.upper()}_COMPLETE"
    if option == OPTIONS[0]:
        typer.echo(get_completion_script(prog_name=NAME, complete_var=variable, shell=shell))
    else:
        _, path = install(shell=shell, prog_name=NAME, complete_var=variable)
        typer.echo(f"Completion for {shell} is installed in {path}; it works in terminals opened from now on")
    raise typer.Exit
