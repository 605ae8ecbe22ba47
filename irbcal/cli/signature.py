"""Commands made from functions of the API: an option's name, choices, default and explanation stand once.

They are read from the function's signature and numpydoc docstring in its source: help imports no numpy. What a shell
types otherwise than Python (millimetres, degrees, numbers with commas between them) is declared beside the command.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass, field
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperCommand

from irbcal.declared_options import PANELS, REQUIRED, DeclaredOption, options_of, source_of
from irbcal.errors import OptionError, not_among
from irbcal.option_values import OutOfRange
from irbcal.overwriting import refuse_overwriting, replacing
from irbcal.safe_files import STDIN
from irbcal.units import DEG as DEG_PER_RAD
from irbcal.units import MM as MM_PER_M

EXPERT = "Expert"
"""Panel that only --help-all shows."""
HELP_ALL_KEY = "irbcal.help-all"
NAMELESS = {"calibration": "Calibration folder.", "measurements": "Measurement file (CSV, XLSX or Parquet)."}
"""Texts of parameters whose docstrings say no more than their type."""
NO_OPTIONS = ("progress",)
"""Parameters of functions that are no options."""


@dataclass(frozen=True)
class Typed:
    """How a value is typed in a shell."""

    kind: Any
    """What typer reads: float, str, Path, ..."""
    metavar: str | None
    """What help shows for it."""
    read: Callable[[Any, str], Any] = lambda value, option: value
    """Value as typed, and the option's name, to the function's value."""
    as_typed: Callable[[Any], Any] = lambda value: value
    """The function's default as it would be typed."""


def _is_name(robot: object) -> bool:
    """Whether a robot is one by name though a folder is called like it, such as that of its calibration."""
    if not (isinstance(robot, str) and os.path.isdir(robot)):
        return False
    from irbcal.io.robots import named_robot

    return named_robot(robot) is not None


def scaled(factor: float, metavar: str) -> Typed:
    """A number in another unit."""
    return Typed(float, metavar, lambda value, option: value * factor, lambda value: round(value / factor, 12))


MM, DEG = scaled(MM_PER_M, "MM"), scaled(DEG_PER_RAD, "DEGREES")
NAMES = Typed(str, "NAME,NAME,…", lambda text, option: [name.strip() for name in text.split(",")])


def numbers(metavar: str, *counts: int, units: Sequence[float] = ()) -> Typed:
    """Numbers with commas between them, as a list: each in its unit, the last unit for all that follow."""

    def factors(count: int) -> list[float]:
        return [*units, *[units[-1] if units else 1.0] * count][:count]

    def read(text: str, option: str) -> list[float]:
        values = numbers_in(text, counts, option)
        return [value * factor for value, factor in zip(values, factors(len(values)), strict=True)]

    def shown(values: Sequence[float]) -> str:
        return ",".join(f"{value / factor:g}" for value, factor in zip(values, factors(len(values)), strict=True))

    return Typed(str, metavar, read, shown)


def numbers_in(text: str, counts: Sequence[int], option: str, names: Sequence[str] = ()) -> list[float]:
    """Numbers separated by commas; a wrong call if their count is another, ``names`` says of what."""
    try:
        values = [float(value) for value in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(map(math.isfinite, values)):
        expected = f"{' or '.join(map(str, counts))} numbers" + (f" ({', '.join(names)})" if names else "")
        raise typer.BadParameter(f"expected {expected}, found {text!r}", param_hint=option)
    return values


PLACE = numbers("X,Y,Z", 3, units=[MM_PER_M])


def _joints(text: str, option: str) -> list[int]:
    try:
        return [int(joint) for joint in text.split(",")]
    except ValueError:
        raise typer.BadParameter(f"expected numbers of joints such as 3,5, found {text!r}", param_hint=option) from None


LOST_JOINTS = Typed(str, "JOINT,JOINT,…", _joints)


def option_of(name: str) -> str:
    """The name of a function's option in a shell."""
    return f"--{name.rstrip('_').replace('_', '-')}"


def explained(option: DeclaredOption, names: Sequence[str]) -> str:
    """What an option means, in words of a shell."""
    nameless = NAMELESS.get(option.name, "") if not option.text else ""
    return nameless or for_shells(" ".join(option.text.split()), names)


def for_shells(text: str, names: Sequence[str]) -> str:
    """An explanation without links and what Python alone takes, ``(in Python …)``, with options as a shell has them."""
    text = re.sub(r" \(in Python [^()]*\)", "", text)
    text = re.sub(r"[,;:]? ?\(?\bsee `[^`]*`\)?", "", text, flags=re.IGNORECASE)
    text = re.sub(r"`irbcal\.(?:\w+\.)*(\w+)`", _as_command, text)
    for name in names:
        text = text.replace(f"``{name}``", option_of(name))
    return text.replace("``", "").strip()


def _as_command(function: re.Match[str]) -> str:
    """A function as a shell calls it; what is no command by its name."""
    name = function[1]
    command = {"calibrate": "calibrate", "robots": "robots", "import_measurements": "import"}.get(name, "")
    if name.startswith("fleet_"):
        command = name.replace("_", " ")
    return f"irbcal {command}" if command else name


def _typed(option: DeclaredOption) -> Typed:
    """How an option is typed by its annotation."""
    kind = option.annotation
    if option.choices:
        return Typed(Literal[option.choices], f"<{' | '.join(option.choices)}>")
    if "Sequence[str]" in kind:
        return Typed(list[str], "NAME")
    if kind == "list[Path]":
        return Typed(list[Path], "FILE")
    for plain in (bool, int, float):
        if re.match(rf"{plain.__name__}\b", kind):
            return Typed(plain, METAVARS[plain])
    return Typed(Path, METAVARS[Path]) if option.is_file else Typed(str, METAVARS[str])


METAVARS: dict[Any, str] = {bool: "", int: "N", float: "NUMBER", Path: "FILE", list[Path]: "FILE", str: "NAME"}
"""What help shows for a value whose name says nothing else."""


@dataclass(frozen=True, eq=False)
class Command:
    """Makes a command of a public function.

    It decorates a function of the API's options (a dict of those that were typed, in the API's units) and of the
    command's own options, which typer knows by their annotations.
    """

    api: str
    """Its name at the front door; or several, with spaces between them: the first that has a parameter explains it."""
    _: KW_ONLY
    arguments: Sequence[str] = ()
    """Parameters that have no option: they are typed in this order."""
    typed: Mapping[str, Typed] = field(default_factory=dict)
    """Parameters that a shell types otherwise."""
    flags: Mapping[str, str] = field(default_factory=dict)
    """Options of other names, or several with spaces between them."""
    panels: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Panels of the help with their options, those of the command, too. Where there are any, all other options are for
    experts: --help-all shows them.
    """
    without: Sequence[str] = ()
    """Parameters that are no options."""
    optional: Sequence[str] = ()
    """Parameters that a shell may leave out although a function needs them."""
    texts: Mapping[str, str] = field(default_factory=dict)
    """Explanations of parameters that a shell understands otherwise."""

    def __call__(self, function: Callable[..., None]) -> Callable[..., None]:
        """The function as it is: what typer runs is made where it is called, see `for_typer`."""
        COMMANDS[function] = self
        return function

    def for_typer(self, function: Callable[..., None]) -> Callable[..., None]:
        """What typer runs of a function that this decorates."""
        arguments, typed, flags = self.arguments, COMMON | {**self.typed}, COMMON_FLAGS | {**self.flags}
        first = ""
        parameters: dict[str, DeclaredOption] = {}
        help_of: dict[str, str] = {}
        for name in self.api.split():
            text, declared = options_of(name)
            first = first or text
            new = {
                parameter.name: parameter
                for parameter in declared
                if parameter.name not in (*NO_OPTIONS, *self.without, *parameters)
            }
            help_of |= {
                parameter.name: explained(parameter, [other.name for other in declared]) for parameter in new.values()
            }
            parameters |= new
        panel_of = {name: parameter.panel for name, parameter in parameters.items() if parameter.panel is not None}
        panel_of |= {name: panel for panel, names in self.panels.items() for name in names}

        hints = inspect.signature(function, eval_str=True).parameters
        kinds = {name: typed.get(name, _typed(parameter)) for name, parameter in parameters.items()}
        hinted = [parameter for parameter in hints.values() if parameter.name != "options"]
        everyday = []
        for name, parameter in parameters.items():
            kind = kinds[name]
            needed = parameter.default is REQUIRED and name not in self.optional
            default = None if parameter.default in (REQUIRED, None, (), False) else kind.as_typed(parameter.default)
            text = escape(self.texts.get(name) or _in_units(help_of[name], kind))
            panel = panel_of.get(name, EXPERT if panel_of else None)
            if name in arguments:
                info: Any = typer.Argument(help=text, show_default=default is not None, metavar=None)
            else:
                info = typer.Option(
                    *flags.get(name, option_of(name)).split(),
                    help=text,
                    show_default=default is not None,
                    metavar=kind.metavar,
                    rich_help_panel=None if needed else panel,
                )
            if kind.kind is bool:
                default = False
            annotation: Any = kind.kind if needed or kind.kind is bool else kind.kind | None
            everyday.append(_by_name(name, Annotated[annotation, info], REQUIRED if needed else default))
        more = [_by_name(parameter.name, _in_panel(parameter, panel_of), parameter.default) for parameter in hinted]
        optional = [each.name for each in (*everyday, *more) if each.default is not REQUIRED]
        if panel_of and not panel_of.keys() >= {*optional}:
            more.append(_by_name("help_all", HELP_ALL, False))
        writes = any(name in OUTPUTS for name in (*parameters, *hints)) and "force" not in hints
        if writes:
            more.append(_by_name("force", FORCE, False))
        more.append(_by_name("context", typer.Context))
        in_panels = sorted(panel_of, key=lambda name: PANELS.index(panel_of[name]))
        order = {name: k for k, name in enumerate([*arguments, *in_panels])}
        every = sorted([*everyday, *more], key=lambda parameter: order.get(parameter.name, len(order)))

        @functools.wraps(function)
        def call(context: typer.Context, **values: Any) -> None:
            options, _ = {}, values.pop("help_all", None)
            force = values.pop("force") if writes else values.get("force", False)
            for name in parameters:
                value = values.pop(name)
                source = context.get_parameter_source(name)
                if source is not None and source.name != "DEFAULT":  # else the function's own
                    options[name] = kinds[name].read(value, flags.get(name, option_of(name)))
            with refusals(arguments, flags, typed), replacing(force):
                function(options, **values)

        call.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]  # what typer reads
        call.__annotations__ = {parameter.name: parameter.annotation for parameter in every}
        call.__doc__ = escape(function.__doc__ or for_shells(first, list(parameters)))
        del call.__wrapped__  # typer would read the function within
        return call


def _by_name(name: str, annotation: Any, default: Any = REQUIRED) -> inspect.Parameter:
    """A parameter as typer reads it."""
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


COMMON: dict[str, Typed] = {
    "package_dirs": Typed(list[Path], "FOLDER"),
    **dict.fromkeys(("baseline", "calibration", "data", "figures", "folder", "plots", "with_"), Typed(Path, "FOLDER")),
    **dict.fromkeys(("robot", "source"), Typed(str, "ROBOT")),
    **dict.fromkeys(("base_link", "tip_link"), Typed(str, "LINK")),
    "coupling": Typed(str, "3+2|none"),
    "joint": Typed(int, "JOINT"),
    "holdout": Typed(float, "SHARE"),
    "payload": Typed(float, "KG"),
    **dict.fromkeys(("rest", "wait", "wait_s", "window"), Typed(float, "SECONDS")),
}
"""Parameters of several commands, as each takes them unless it says otherwise."""
COMMON_FLAGS = {"package_dirs": "--package-dir"}
COMMANDS: dict[Callable[..., None], Command] = {}
"""Functions of commands, with what decorates them."""


def for_typer(function: Callable[..., None]) -> Callable[..., None]:
    """What typer runs: of a function that `Command` decorates with its options, any other one as it is.

    The sources that say them are read here, not by the decorator: of the commands of a file one is called.
    """
    return COMMANDS[function].for_typer(function) if function in COMMANDS else function


def escape(text: str) -> str:
    """A text as help shows it, which reads [x] as a style."""
    return re.sub(r"\[(?=[a-z#/@])", r"\\[", text)


HELP_ALL = Annotated[bool, typer.Option("--help-all", help="Show options for experts, too.")]
"""Named by the help of commands that have such options; all take it, see `Guarded.parse_args`."""
FORCE = Annotated[bool, typer.Option("--force", help="Replace files that irbcal did not write, too.")]
"""Of commands that write files."""


def _in_panel(parameter: inspect.Parameter, panel_of: Mapping[str, str]) -> Any:
    """The annotation of a command's own option, in its panel."""
    import copy

    info, kind = copy.copy(parameter.annotation.__metadata__[0]), parameter.annotation.__origin__
    if isinstance(info, typer.models.OptionInfo) and info.metavar is None:
        info.metavar = _metavar(parameter.name, next((plain for plain in METAVARS if kind == plain | None), kind))
    if isinstance(info, typer.models.OptionInfo) and panel_of and parameter.default is not REQUIRED:
        info.rich_help_panel = panel_of.get(parameter.name, EXPERT)
    return Annotated[kind, info]


def _metavar(name: str, kind: Any) -> str | None:
    """What help shows for a value, by its name or its type."""
    return COMMON[name].metavar if name in COMMON else METAVARS.get(kind)


def _in_units(text: str, kind: Typed) -> str:
    """An explanation in the units of a shell."""
    if kind.metavar is None or kind.kind not in (float, str):
        return text
    return re.sub(r"\bmetres\b", "mm", re.sub(r"\bradians\b", "degrees", text))


def for_function(api: str, options: Mapping[str, Any], words: str) -> None:
    """Refuse options that a public function does not have.

    Parameters
    ----------
    api : str
    options : dict
        As they were typed.
    words : str
        What to say of one that it does not have.

    Raises
    ------
    OptionError
        If there is one.
    """
    known = {item.name for item in options_of(api)[1]}
    for name in options:
        if name not in known:
            raise OptionError(words, parameter=name)


def public(name: str) -> Any:
    """A public function, imported."""
    module, function = source_of(name)
    return getattr(import_module(module), function)


@contextmanager
def refusals(
    arguments: Sequence[str] = (), flags: Mapping[str, str] | None = None, typed: Mapping[str, Typed] | None = None
) -> Iterator[None]:
    """Turn an `OptionError` into a wrong call (exit code 2) that names the option, numbers as typed."""
    try:
        yield
    except OptionError as error:
        name = error.parameter or ""
        hint = name.upper() if name in arguments else (flags or {}).get(name, option_of(name))
        sentence = str(error).removeprefix(f"{name}: ")  # the hint says it
        if isinstance(error, OutOfRange) and typed and name in typed and typed[name].kind is float:
            sentence = error.sentence(typed[name].as_typed)
        raise typer.BadParameter(sentence, param_hint=hint if name else None) from None


def path_to_write(text: str | Path) -> Path:
    """A path as typed; an empty text, such as of a shell variable that is not set, would be the current folder."""
    if not str(text).strip():
        raise typer.BadParameter("expected a name, found an empty text")
    return Path(text)


FAIL_IF_WORSE = "End with exit code 3 unless the verdict is better than the nominal robot, and trusted."
VERBOSE = "Print all: errors of each reflector, term sets, combinations that are held, points left out, notes."
OutFile = Annotated[Path, typer.Option(parser=path_to_write, metavar="PATH", help="File to write.")]
Json = Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")]
JsonLines = Annotated[bool, typer.Option("--json", help="JSON lines in place of CSV.")]
Verbose = Annotated[bool, typer.Option("--verbose", help=VERBOSE)]
FailIfWorse = Annotated[bool, typer.Option("--fail-if-worse", help=FAIL_IF_WORSE)]


OUTPUTS = (
    *("out", "changes", "html", "page", "plot", "plots", "figures", "data", "report", "csv", "latex", "declare"),
    "cell urdf",
)
"""Parameters that name files or folders to write, of every command or of the named one: all others are read."""
INTERRUPTED = 130
"""Exit code, as shells have it."""


NUMBER_MESSAGES = {"Input should be a valid number": "a number", "Input should be a valid integer": "a whole number"}
"""Beginnings of typer's sentences, and what it expected."""


def _expected(error: typer.BadParameter, typed: Sequence[str]) -> str:
    """What typer says of a wrong value, in the words of irbcal."""
    choice = re.search(r"(?:^|, )((['\"]).*\2) is not one of (.*?)\.?$", error.message)
    if choice:
        return not_among(ast.literal_eval(choice[1]), ast.literal_eval(f"({choice[3]},)"))
    kind = next((number for beginning, number in NUMBER_MESSAGES.items() if error.message.startswith(beginning)), None)
    if kind is None:
        return error.message
    options = [] if error.param is None else error.param.opts
    values = [word for before, word in pairwise(typed) if before in options]
    values += [word.partition("=")[2] for word in typed if word.partition("=")[0] in options and "=" in word]
    return f"expected {kind}" + (f", found {values[-1]!r}" if values else "")


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
            elif kind is not None and param.param_type_name == "argument":
                word = _metavar(param.name, kind.annotation) or param.display_type(ctx)
                param.display_type = lambda ctx, word=word: word
            if getattr(param, "rich_help_panel", None) == EXPERT:
                param.hidden = HELP_ALL_KEY not in ctx.meta
        super().format_help(ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the options; a wrong value is refused in a sentence that says what was expected, and what is nearest."""
        typed = list(args)
        if "--help-all" in typed:
            ctx.meta[HELP_ALL_KEY] = True
            typer.echo(ctx.get_help(), color=ctx.color)
            raise typer.Exit
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            error.message = _expected(error, typed)
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run the command, unless an output is an input or another output; say where it goes on if it is stopped."""
        outputs, inputs = {}, []
        for name, value in ctx.params.items():
            if name in OUTPUTS or f"{ctx.info_name} {name}" in OUTPUTS:
                outputs[name] = value
                if str(value) == STDIN:
                    raise typer.BadParameter("expected a file or folder to write, found -", param_hint=option_of(name))
            elif name != "robot" or not _is_name(value):
                inputs.append(value)
        refuse_overwriting(outputs, *inputs, command=ctx.info_name)
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stopped:
            from irbcal.parallel import Interrupted

            if not isinstance(stopped, Interrupted):
                raise
            typer.echo(f"irbcal: {stopped}", err=True)
            raise typer.Exit(INTERRUPTED) from None
