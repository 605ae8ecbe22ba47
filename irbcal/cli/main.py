"""The ``irbcal`` command: its subcommands, in files that are loaded when one of theirs is called."""

from __future__ import annotations

import ast
import errno
import inspect
import os
import re
import sys
import warnings
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from irbcal.errors import IrbcalError

NAME = "irbcal"
PANELS = {
    "Calibrate": {
        "demo": "calibrate",
        "import": "measurements",
        "corners": "measurements",
        "lens": "measurements",
        "hand-eye": "measurements",
        "calibrate": "calibrate",
        "evaluate": "calibrate",
        "compare": "calibrate",
        "view": "calibrate",
        "fleet": "fleet",
        "report": "calibrate",
        "app": "app",
    },
    "Prepare": {
        "robots": "prepare",
        "urdf": "prepare",
        "plan": "prepare",
        "simulate": "prepare",
        "samples": "prepare",
    },
    "Use": {
        "fk": "use",
        "ik": "use",
        "cell": "programs",
        "filter": "programs",
        "export": "use",
        "stream": "use",
        "verify": "use",
        "sign": "use",
    },
    "Validate": {
        "joints": "validate",
        "circles": "validate",
        "controller": "validate",
        "iso9283": "validate",
        "tracker": "validate",
        "ballbar": "validate",
    },
}
"""Commands in the groups of the list, each with the module that has it."""
MODULES = {name: module for commands in PANELS.values() for name, module in commands.items()}
COMMANDS = tuple(MODULES)
FUNCTIONS = {"import": "import_files", "filter": "filter_program", "hand-eye": "hand_eye"}
"""Functions of commands that have another name."""
GROUPS = {"fleet"}
"""Names that have commands of their own behind them: their module has a Typer ``app``."""
SHELLS = ("bash", "zsh", "fish", "powershell", "pwsh")
OPTIONS = ("--show-completion", "--install-completion")


class Root(TyperGroup):
    """A group whose options for completion take the shell's name, too: ``irbcal --show-completion bash``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Serve completion for a named shell; the list of commands has no options for experts to show."""
        if args[:1] == ["--help-all"]:
            args = ["--help"]
        if args and args[0] in OPTIONS:
            _complete(args[0], args[1] if len(args) > 1 else None)
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Help whose switches show no type."""
        params: list[Any] = self.get_params(ctx)
        for param in params:
            if getattr(param, "is_flag", False):
                param.metavar = ""
        super().format_help(ctx, formatter)


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


if TYPE_CHECKING:
    app: typer.Typer

HELP = "Calibrate robot arms from laser-tracker measurements: corrected URDF, joint map, proof."
PACKAGES = {"collada": "pycollada", "pinocchio": "pin", "yaml": "pyyaml"}
PACKAGES |= dict.fromkeys(("nicegui", "fastapi", "uvicorn"), "'irbcal[app]'")
PACKAGES |= {"sqlalchemy": "'irbcal[fleet]'", "cv2": "'irbcal[camera]'", "pyarrow": "'irbcal[parquet]'"}
"""Packages whose modules have other names, and extras that bring them."""
HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}


def _version(wanted: bool) -> None:
    if wanted:
        from irbcal import __version__

        print(f"irbcal {__version__}")
        if "--verbose" in sys.argv:  # which may stand behind it
            from irbcal import kernel

            print(f"kernel: {kernel.STATE}")
        raise typer.Exit


def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="With --version: say what computes kinematics.")] = False,
) -> None:
    """Calibrate robot arms from laser-tracker measurements: corrected URDF, joint map, proof."""


def application(names: Iterable[str] = COMMANDS, summary: bool = False) -> typer.Typer:
    """The command line with some of its commands.

    Parameters
    ----------
    names : iterable of str
        What is loaded: one command needs no other one.
    summary : bool
        Only what the list of commands says of each.
    """
    from irbcal.cli.signature import Guarded

    app = typer.Typer(
        name=NAME,
        cls=Root,
        help=HELP,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings=HELP_OPTIONS,
    )
    app.callback()(common)
    for panel, modules in PANELS.items():
        for name, module in modules.items():
            if name in names and name in GROUPS and not summary:
                group = import_module(f"irbcal.cli.{module}").app
                app.add_typer(group, cls=Root, name=name, rich_help_panel=panel, context_settings=HELP_OPTIONS)
            elif name in names:
                function = _listed if summary else _function(name)
                text = _summary(name) if summary else _reflowed(function.__doc__ or "")
                app.command(name, help=text, rich_help_panel=panel, cls=Guarded)(function)
    return app


def _reflowed(docstring: str) -> str:
    """A docstring whose paragraphs the terminal wraps; command lines keep lines of their own."""
    return re.sub(r"(?<!\n)\n(?!\n|irbcal )", " ", inspect.cleandoc(docstring))


def _summary(name: str) -> str:
    """What a command says of itself first, from its file as text: the list of commands loads none of them."""
    tree = _tree(MODULES[name])
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    text = ast.get_docstring(functions[FUNCTIONS.get(name, name)]) if name not in GROUPS else ast.get_docstring(tree)
    return " ".join(str(text).partition("\n\n")[0].split())


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8"))


def _function(name: str) -> Any:
    """The function of a command, as typer takes it."""
    from irbcal.cli.signature import for_typer

    return for_typer(getattr(import_module(f"irbcal.cli.{MODULES[name]}"), FUNCTIONS.get(name, name)))


def _listed() -> None:
    """Stand for a command in the list of commands."""


def __getattr__(name: str) -> Any:
    """``app``, all commands, made when it is asked for first."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = application()
    return globals()[name]


def _called(arguments: list[str]) -> typer.Typer:
    """As much of the command line as these words need, or those that a shell wants to complete."""
    if "app" in globals():
        return globals()["app"]
    if f"_{NAME.upper()}_COMPLETE" in os.environ:
        typed = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
        command = typed.split()[1:2] if len(typed.split()) > 2 or typed[-1:].isspace() else []
        return application(command) if set(command) & set(COMMANDS) else application(summary=True)
    if "--version" in arguments[:1]:
        return application(())
    if arguments[:1] and arguments[0] in COMMANDS:
        return application(arguments[:1])
    if arguments in (["--help"], ["-h"], ["--help-all"]):
        return application(summary=True)
    return application()


def main() -> None:
    """Run a command; refusals become one sentence on stderr and exit code 1."""
    try:
        with warnings.catch_warnings():
            # numbers that overflow are refused in a sentence of ours, or end in a result that is checked
            warnings.simplefilter("ignore", RuntimeWarning)
            _called(sys.argv[1:])(prog_name=NAME)
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if name in ("", "irbcal"):
            raise
        package = PACKAGES.get(name, name)
        print(f"irbcal: this needs {package}, which is not installed: pip install {package}", file=sys.stderr)
        sys.exit(1)
    except IrbcalError as error:
        print(f"irbcal: {error}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        if error.filename is not None:  # a name too long, a circle of links, a disk that fails
            print(f"irbcal: {IrbcalError(str(error.strerror), file=error.filename)}", file=sys.stderr)
            sys.exit(1)
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"irbcal: cannot write the output: {error.strerror}", file=sys.stderr)
        sys.exit(1)
