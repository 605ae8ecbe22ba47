"""Options as the source declares them: name, type, default, meaning, and marks such as bounds.

A public function declares its options in its signature and numpydoc docstring. Or it works on an object whose class
declares them (`takes_fields_of`): each field is an option, and the text below it says what it means; what several
functions have stands in a class that theirs extend. All are read from the source, nothing is imported for it: the
command line makes its options from them, and its help loads no numpy.
"""

from __future__ import annotations

import ast
import functools
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields, replace
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from textwrap import TextWrapper
from typing import Any, ParamSpec, TypeVar

from irbcal.option_values import checked, names, number

P = ParamSpec("P")
Options = TypeVar("Options")
R = TypeVar("R")

REQUIRED = inspect.Parameter.empty


class HelpPanel(str):
    """Mark of an option: the panel of the help where it stands; without, it is for experts."""

    __slots__ = ()


EVERYDAY = HelpPanel("Everyday")
MEASUREMENTS = HelpPanel("Measurements")
MODEL = HelpPanel("Model")
PANELS = ("Options", EVERYDAY, MEASUREMENTS, MODEL)
"""In the order of the help, which calls the first one so by itself: options that are needed."""


@dataclass(frozen=True)
class Bounds:
    """Mark of an option that is a number: the smallest and the largest that make sense."""

    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class DeclaredOption:
    """An option as the source declares it."""

    module: str
    """Where it is declared."""
    name: str
    annotation: str
    """Without marks; a name that stands for choices is replaced by these."""
    default: Any
    """`REQUIRED` where there is none, None where only Python knows it."""
    text: str
    """What it means."""
    choices: tuple[str, ...] = ()
    marks: tuple[Any, ...] = ()
    """What else `typing.Annotated` says."""
    by_name: bool = False
    """Whether a call must name it."""

    @property
    def panel(self) -> str | None:
        """Where the help shows it."""
        return next((str(mark) for mark in self.marks if isinstance(mark, HelpPanel)), None)

    @property
    def is_file(self) -> bool:
        """Whether a path may be given."""
        return not self.annotation.startswith("Sequence") and _names_path(self.module, self.annotation)

    def check(self, value: Any) -> None:
        """Refuse a value that is none of the choices, beyond the bounds, or no sequence of names.

        Raises
        ------
        OptionError
            In one sentence, which says what was expected.
        """
        if value is None and self.default is None:
            return
        if self.choices:
            checked(self.name, value, self.choices)
        elif self.annotation.startswith("Sequence[str]"):
            names(self.name, value)
        for mark in self.marks:
            if isinstance(mark, Bounds):
                number(self.name, value, mark.low, mark.high, whole=self.annotation.startswith("int"))


# --- of an object's class -------------------------------------------------------------------------------------


def takes_fields_of(options: Callable[P, Options]) -> Callable[[Callable[[Options], R]], Callable[P, R]]:
    """Make a function of an object one of the object's fields: its signature and docstring list these.

    Parameters
    ----------
    options : type
        A dataclass with a text below each field.

    Returns
    -------
    callable
        Decorates a function of one argument, an instance of that class.
    """

    def decorate(function: Callable[[Options], R]) -> Callable[P, R]:
        signature = inspect.signature(options)

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            return function(options(*args, **kwargs))

        declared = fields_of(options)
        hints = {option.name: option.annotation for option in declared} | {"return": function.__annotations__["return"]}
        parameters = [item.replace(annotation=hints[name]) for name, item in signature.parameters.items()]
        call.__signature__ = signature.replace(  # type: ignore[attr-defined]  # what help() shows
            parameters=parameters, return_annotation=hints["return"]
        )
        call.__annotations__ = hints
        call.__doc__ = _with_parameters(inspect.getdoc(function) or "", declared)
        return call

    return decorate


def fields_of(options: Any) -> tuple[DeclaredOption, ...]:
    """Fields of a class of options, as its source declares them."""
    return _fields(options.__module__, options.__qualname__)


def check_fields(options: Any) -> None:
    """Refuse the first field whose value is not as declared, see `DeclaredOption.check`."""
    for option in fields_of(type(options)):
        option.check(getattr(options, option.name))


def changed_options(options: Any, mark: str | None = None) -> list[str]:
    """Names of the fields whose values are others than their defaults; on request only of those with a mark."""
    marked = {option.name for option in fields_of(type(options)) if mark is None or mark in option.marks}
    return [
        field.name
        for field in fields(options)
        if field.name in marked and _differs(getattr(options, field.name), field.default)
    ]


def _differs(value: Any, default: Any) -> bool:
    if default is MISSING:
        return True
    if value is default or (default == () and isinstance(value, Sized) and not len(value)):
        return False
    try:
        return bool(value != default)
    except ValueError:  # of arrays and tables, which are no default
        return True


_INDENTED, _HANGING = (TextWrapper(120, first, "    ", break_on_hyphens=False) for first in ("    ", ""))


def _with_parameters(docstring: str, options: Iterable[DeclaredOption]) -> str:
    """A docstring with a section of the parameters, before what it says of errors."""
    lines = ["Parameters", "----------"]
    for option in options:
        kind = re.sub(r"Literal\[(.*?)\]", r"{\1}", option.annotation)
        lines += [*_HANGING.wrap(f"{option.name} : {kind}"), *_INDENTED.wrap(option.text)]
    begin, raises, end = docstring.partition("Raises\n------\n")
    return "\n".join([begin.rstrip(), "", *lines, "", raises + end])


# --- from the source ------------------------------------------------------------------------------------------


@functools.cache
def source_of(name: str) -> tuple[str, str]:
    """Module and name of a function: of a public one by the front door's list, of any other by its module's name."""
    module, _, function = name.rpartition(".")
    if module:
        return f"irbcal.{module}", function
    stub = ast.parse((Path(__file__).parent / "__init__.pyi").read_text(encoding="utf-8"))
    for node in stub.body:
        if isinstance(node, ast.ImportFrom) and node.level == 1 and node.module:
            for alias in node.names:
                if alias.asname == name:
                    return f"irbcal.{node.module}", alias.name
    raise LookupError(name)


@functools.cache
def options_of(name: str) -> tuple[str, tuple[DeclaredOption, ...]]:
    """First paragraphs of a public function's docstring, and its options."""
    module, function = source_of(name)
    nodes = (
        node for node in _tree(module, function).body if isinstance(node, ast.FunctionDef) and node.name == function
    )
    node = next(nodes, None)
    if node is None:
        raise LookupError(f"irbcal.{name} is no function")
    docstring = ast.get_docstring(node) or ""
    first = re.split(r"\n(?:Parameters|Returns|Raises)\n", docstring)[0].strip()
    for decorator in node.decorator_list:
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == takes_fields_of.__name__:
            return first, _fields(*_origin(module, ast.unparse(decorator.args[0])))
    texts = dict(texts_of(docstring))
    every = [*node.args.posonlyargs, *node.args.args]
    defaults: list[ast.expr | None] = [None] * (len(every) - len(node.args.defaults))
    pairs = [*zip(every, [*defaults, *node.args.defaults], strict=True)]
    pairs += zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True)
    if node.args.vararg is not None:
        node.args.vararg.annotation = ast.Name("list[Path]")
        pairs.insert(0, (node.args.vararg, None))
    out = []
    for argument, default in pairs:
        kind, text = texts.get(argument.arg, ("", ""))
        braces = re.search(r"\{(.*?)\}", kind)
        choices = tuple(choice.strip(" \"'") for choice in braces[1].split(",")) if braces else ()
        option = _option(module, argument.arg, argument.annotation, default, text)
        out.append(replace(option, choices=choices or option.choices))
    return first, tuple(out)


@functools.cache
def _fields(module: str, name: str) -> tuple[DeclaredOption, ...]:
    """Fields of a class and of those that it extends, in the order of the signature."""
    return tuple(sorted(_declared(module, name).values(), key=lambda option: option.by_name))


def _declared(module: str, name: str) -> dict[str, DeclaredOption]:
    """Fields by their names, with the texts below them; those of the classes that it extends before its own."""
    node = next(node for node in _tree(module, name).body if isinstance(node, ast.ClassDef))
    out: dict[str, DeclaredOption] = {}
    for base in reversed(node.bases):
        out |= _declared(*_origin(module, ast.unparse(base)))
    by_name = False
    for field, below in pairwise([*node.body, ast.Pass()]):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            if field.target.id == "_":  # KW_ONLY
                by_name = True
                continue
            text = ""
            if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
                text = inspect.cleandoc(str(below.value.value))
            option = _option(module, field.target.id, field.annotation, field.value, text)
            out[option.name] = replace(option, by_name=by_name)
    return out


def _option(module: str, name: str, annotation: ast.expr | None, default: ast.expr | None, text: str) -> DeclaredOption:
    """An option by its annotation, which may have marks."""
    marks: list[ast.expr] = []
    if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value) == "Annotated":
        assert isinstance(annotation.slice, ast.Tuple)
        annotation, *marks = annotation.slice.elts
    kind = _annotation(module, annotation)
    choices = re.match(r"Literal\[(.*?)\]", kind)
    return DeclaredOption(
        module,
        name,
        kind,
        REQUIRED if default is None else _value(module, default),
        _explained_elsewhere(name, text) or text,
        tuple(ast.literal_eval(f"({choices[1]},)")) if choices else (),
        tuple(_value(module, mark) for mark in marks),
    )


@functools.cache
def _tree(module: str, name: str = "") -> ast.Module:
    """The source of a module, which is not imported: its statements, of functions and classes the named one only."""
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    source = Path(spec.origin).read_text(encoding="utf-8")
    return ast.parse(_DEFINITION.sub(lambda match: match[0] if match[1] == name else "", source))


_DEFINITION = re.compile(
    r"^(?:@.*\n(?:[ )].*\n)*)*(?:def|class) (\w+)[(:].*\n(?:(?:[ )].*)?\n)*",
    re.MULTILINE,
)
"""A function or class of a module with its decorators: lines below are indented, or close a bracket."""


def _origin(module: str, name: str) -> tuple[str, str]:
    """Module and name of what a module calls so: its own, or imported."""
    return _imported(module).get(name, (module, name))


@functools.cache
def _imported(module: str) -> dict[str, tuple[str, str]]:
    """Module and name of what a module imports, by what it calls it; some is imported for types alone."""
    out: dict[str, tuple[str, str]] = {}
    for statement in ast.walk(_tree(module)):
        if isinstance(statement, ast.ImportFrom) and statement.module:
            for alias in statement.names:
                out.setdefault(alias.asname or alias.name, (statement.module, alias.name))
    return out


def _annotation(module: str, node: ast.expr | None) -> str:
    """An annotation as text; a name that stands for choices, by these."""
    text = "" if node is None else ast.unparse(node)
    first, bar, others = text.partition(" | ")
    return f"{_choices(module, first) or first}{bar}{others}"


def _choices(module: str, name: str) -> str:
    """The choices that a name stands for, as text; empty where it stands for none."""
    kind = _alias(module, name)[1]
    return kind if kind.startswith("Literal[") else ""


@functools.cache
def _names_path(module: str, kind: str) -> bool:
    """Whether a type's text, or an alias in it, names a path."""
    words = set(re.findall(r"[A-Za-z_]\w*", kind))
    return not words.isdisjoint(("Path", "PathLike")) or any(_names_path(*_alias(module, word)) for word in words)


def _alias(module: str, name: str) -> tuple[str, str]:
    """What a name stands for as a type, as text, and the module that says so; no text where it stands for no other."""
    origin, known = _origin(module, name)
    if origin != module:
        return _alias(origin, known) if origin.startswith("irbcal") else (origin, "")
    for statement in _tree(module).body:
        if isinstance(statement, ast.AnnAssign) and ast.unparse(statement.target) == name and statement.value:
            return module, ast.unparse(statement.value)
    return module, ""


def _value(module: str, node: ast.expr) -> Any:
    """Value of a default: literals, and constants of this and of other modules."""
    try:
        known = {leaf.id: _constant(module, leaf.id) for leaf in ast.walk(node) if isinstance(leaf, ast.Name)}
    except LookupError:
        return None
    return eval(compile(ast.Expression(node), module, "eval"), {"__builtins__": {}}, known)


def _constant(module: str, name: str) -> Any:
    for statement in _tree(module).body:
        if isinstance(statement, (ast.Assign, ast.AnnAssign)) and statement.value is not None:
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            if any(isinstance(target, ast.Name) and target.id == name for target in targets):
                return _value(module, statement.value)
    origin, known = _origin(module, name)
    if origin == module:
        raise LookupError(f"{module}: {name}")
    with suppress(LookupError):
        if origin.startswith("irbcal.") and (value := _constant(origin, known)) is not None:
            return value
    return getattr(import_module(origin), known)  # a class, of a light module


def _explained_elsewhere(option: str, text: str) -> str:
    """The explanation of another function's option of this name, where a text only names that function."""
    reference = re.fullmatch(r"(?:As|See) `irbcal\.([\w.]+)`\.?", text)
    if reference is None:
        return ""
    try:
        return next((candidate.text for candidate in options_of(reference[1])[1] if candidate.name == option), "")
    except (LookupError, ImportError):
        return ""


def texts_of(docstring: str) -> Iterator[tuple[str, tuple[str, str]]]:
    """Names of parameters, each with the words after the colon and its explanation."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w[^\n]*\n-+\n|\Z)", docstring, re.DOTALL | re.MULTILINE)
    for entry in re.finditer(
        r"^(\S[^\n]*?)(?: : ([^\n]*))?\n((?:(?:[ \t]+[^\n]*)?\n)*)",
        re.sub(r",\n\s+(?=\")", ", ", section[1] if section else "") + "\n",  # choices on several lines
        re.MULTILINE,
    ):
        for name in entry[1].split(","):
            yield name.strip(" *"), (entry[2] or "", " ".join(entry[3].split()))
