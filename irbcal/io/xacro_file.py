"""xacro files: macros, properties and includes of a robot description become one URDF.

The package ``xacro`` expands macros. It evaluates expressions as Python, which whoever wrote the file could use to run
code: here they are computed by `_Expression`, which knows numbers, texts, lists and the functions of `FUNCTIONS`, and
calls nothing else. Included files are read like any other input: no document types, no pipes, bounded sizes, and none
outside the packages of the robot: what is read may stand in results that are given away.
"""

from __future__ import annotations

import ast
import math
import operator
import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from io import StringIO
from pathlib import Path
from typing import Any

from irbcal.errors import RobotError
from irbcal.io import robots
from irbcal.safe_files import read_bytes

MOST_STEPS = 50_000
"""Expressions and elements of one expansion; the largest public descriptions take some thousands."""
LONGEST = 100_000
"""Characters, or members, of a value."""
MOST_TEXT = 20_000_000
"""Characters of all values of one expansion."""
LARGEST_NUMBER = 2**63
"""Of whole numbers; Python's have no limit."""
LARGEST_INCLUDE = 5_000_000
"""Bytes of an included file."""
ANCESTORS = 5
"""Folders above a file in which and beside which packages are looked up."""

_IS_XACRO = re.compile(rb"<\s*xacro:|xmlns:xacro.*(\$\{|\$\((find|arg|eval|env|optenv|dirname)\b)", re.DOTALL)
"""Expressions count where the name space is declared: in other files they are texts like any."""
_PACKAGE = re.compile(r"[A-Za-z]\w*(-\w+)*")
_LOCK = threading.Lock()

_OF_MATH = (
    math.radians, math.degrees, math.sin, math.cos, math.tan, math.asin, math.acos, math.atan, math.atan2, math.sqrt,
    math.floor, math.ceil, math.fabs, math.hypot, math.exp, math.log, math.log10,
)  # fmt: skip
FUNCTIONS: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (*_OF_MATH, abs, min, max, int, float, str, bool, len, list, dict, tuple, sum, sorted)
} | {"round": lambda value, digits=0: round(float(value), digits) if digits else round(value)}
"""What expressions may call, with or without ``math.``, ``python.`` or ``xacro.`` before it."""

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod, ast.Pow: math.pow,
}  # fmt: skip
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Not: operator.not_,
}  # fmt: skip
_COMPARED: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge, ast.Is: operator.is_, ast.IsNot: operator.is_not,
    ast.In: lambda a, b: a in b, ast.NotIn: lambda a, b: a not in b,
}  # fmt: skip


def is_xacro(data: bytes) -> bool:
    """Whether a robot file still has macros or expressions to expand."""
    return _IS_XACRO.search(data) is not None


def expanded(file: Path, arguments: Mapping[str, str], package_dirs: Sequence[str | Path] = ()) -> bytes:
    """The URDF of a xacro file.

    Parameters
    ----------
    file : Path
    arguments : dict of str to str
        Values of its ``xacro:arg``.
    package_dirs : sequence of str or Path
        Folders in which packages are looked up before all others.

    Raises
    ------
    RobotError
        If a file or package is missing, or it cannot be expanded safely.
    """
    import xacro

    with _LOCK, _guarded(file, package_dirs), redirect_stderr(StringIO()):
        try:
            xacro.init_stacks(str(file))
            document = xacro.parse(None, str(file))
            xacro.process_doc(document, mappings=dict(arguments), verbosity=0)
            text: str = document.toxml()
        except RobotError:
            raise
        except RecursionError:
            raise _refusal(file, "macros or properties refer to each other without end") from None
        except Exception as error:  # xacro raises whatever its input makes Python raise
            raise _refusal(file, " ".join(str(error).split())[:300] or type(error).__name__) from None
    if not document.getElementsByTagName("joint"):
        raise RobotError(
            "this xacro file declares macros and calls none: take the file that includes it and calls its macro",
            file=str(file),
        )
    return re.sub(r"<\?xml[^>]*\?>", "", text, count=1).lstrip().encode()


def _refusal(file: Path | str, reason: str) -> RobotError:
    return RobotError(
        f"this xacro file cannot be expanded ({reason}): name missing arguments ('{Path(file).name} NAME:=VALUE'), or "
        "expand it with ROS (xacro FILE > robot.urdf) and take the URDF",
        file=str(file),
    )


@contextmanager
def _guarded(file: Path, package_dirs: Sequence[str | Path]) -> Iterator[None]:
    """Xacro with our own expressions, files and packages in place of its own."""
    import xacro
    from xacro import substitution_args

    evaluation = _Expression(file, package_dirs)
    replaced: list[tuple[Any, str, Any]] = [
        (xacro, "safe_eval", evaluation.of_text),
        (xacro, "parse", evaluation.document),
        (xacro, "eval_all", evaluation.counted(xacro.eval_all)),
        (xacro, "eval_text", evaluation.counted(xacro.eval_text)),
        (substitution_args, "_eval", lambda text, context: str(evaluation.of_text(text, context["arg"]))),
        (substitution_args, "_eval_find", evaluation.package),
        (substitution_args, "_eval_env", _no_environment),
        (substitution_args, "_eval_optenv", lambda name, default="": default),
    ]
    before = [(module, name, getattr(module, name)) for module, name, _ in replaced]
    try:
        for module, name, value in replaced:
            setattr(module, name, value)
        yield
    finally:
        for module, name, value in before:
            setattr(module, name, value)


def _no_environment(name: str) -> str:
    raise ValueError(f"it asks for the environment variable {name}")


class _Expression:
    """What stands between ``${`` and ``}``, computed without Python's own evaluation.

    Parameters
    ----------
    file : Path
        Of the robot.
    package_dirs : sequence of str or Path
        As `expanded` takes them.
    """

    def __init__(self, file: Path, package_dirs: Sequence[str | Path] = ()) -> None:
        self.arguments = [Path(folder).absolute() for folder in package_dirs]
        self.file, self.steps, self.characters = file, 0, 0
        self.above = file.resolve().parents[:ANCESTORS]
        self.folders = [folder for folder in self.above if (folder / "package.xml").is_file()][:1] or [self.above[0]]
        self.functions = FUNCTIONS | {"load_yaml": self.yaml, "abs_filename": self.path, "dotify": lambda value: value}

    def step(self) -> None:
        """Count a step of the expansion."""
        self.steps += 1
        if self.steps > MOST_STEPS:
            raise ValueError(f"it takes more than {MOST_STEPS} steps")

    def counted(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """A function whose calls are steps, and whose results are bounded."""

        def call(*arguments: Any, **named: Any) -> Any:
            self.step()
            result = bounded(function(*arguments, **named))
            self.characters += len(result) if isinstance(result, str) else 0
            if self.characters > MOST_TEXT:
                raise ValueError(f"it makes more than {MOST_TEXT} characters")
            return result

        return call

    def of_text(self, text: str, symbols: Mapping[str, Any], _: Any = None) -> Any:
        """The value of an expression with some symbols."""
        self.step()
        if len(text) > LONGEST:
            raise ValueError("an expression is too long")
        return self.value(ast.parse(text.strip(), mode="eval").body, symbols)

    def value(self, node: ast.expr, symbols: Mapping[str, Any]) -> Any:
        """The value of a node of an expression, refused where it grows beyond all measure."""
        value = self._value(node, symbols)
        return value if isinstance(node, (ast.Name, ast.Attribute)) else bounded(value)

    def _value(self, node: ast.expr, symbols: Mapping[str, Any]) -> Any:
        match node:
            case ast.Constant(value=bool() | int() | float() | str() | None as value):
                return value
            case ast.Name(id=name):
                return symbols[name] if name in symbols else _named(name)
            case ast.List(elts=operands) | ast.Tuple(elts=operands):
                return [self.value(operand, symbols) for operand in operands]
            case ast.Attribute(value=ast.Name(id="math"), attr="pi"):
                return math.pi
            case ast.Attribute(value=inner, attr=name) if not name.startswith("_"):
                return _member(self.value(inner, symbols), name)
            case ast.Subscript(value=inner, slice=index):
                return _member(self.value(inner, symbols), self.value(index, symbols))
            case ast.UnaryOp(op=op, operand=inner):
                return _UNARY[type(op)](self.value(inner, symbols))
            case ast.BinOp(left=left, op=op, right=right):
                return _combined(type(op), self.value(left, symbols), self.value(right, symbols))
            case ast.BoolOp(op=op, values=operands):
                result: Any = None
                for operand in operands:
                    result = self.value(operand, symbols)
                    if bool(result) is isinstance(op, ast.Or):
                        break
                return result
            case ast.Compare(left=left, ops=ops, comparators=others):
                values = [self.value(operand, symbols) for operand in (left, *others)]
                return all(_COMPARED[type(op)](a, b) for op, a, b in zip(ops, values[:-1], values[1:], strict=True))
            case ast.IfExp(test=test, body=body, orelse=other):
                return self.value(body if self.value(test, symbols) else other, symbols)
            case ast.Call(func=ast.Name(id="dict"), args=[], keywords=pairs):
                return {pair.arg: self.value(pair.value, symbols) for pair in pairs}
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self.called(name, [self.value(operand, symbols) for operand in arguments])
            case ast.Call(
                func=ast.Attribute(value=ast.Name(id="math" | "python" | "xacro"), attr=name),
                args=arguments,
                keywords=[],
            ):
                return self.called(name, [self.value(operand, symbols) for operand in arguments])
        raise ValueError(f"irbcal does not compute {ast.unparse(node)[:100]}")

    def called(self, name: str, arguments: list[Any]) -> Any:
        """What a function gives."""
        if name == "arg":
            import xacro

            return xacro.substitution_args_context["arg"][arguments[0]]
        if name not in self.functions:
            raise ValueError(f"irbcal knows no function {name}")
        return self.functions[name](*arguments)

    def document(self, inp: Any, filename: str | None = None) -> Any:
        """An XML file, read as untrusted input."""
        from xml.dom import minidom

        import xacro

        assert inp is None
        assert filename is not None
        try:
            data = self.read(os.path.join(xacro.root_dir or "", filename))
        except RobotError as error:
            xacro.filestack.pop()
            raise xacro.XacroException(str(error), exc=OSError()) from None
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data or b"\x00" in data:
            raise RobotError("document types and entities are refused in a robot description", file=filename)
        return minidom.parseString(data)

    def path(self, name: str) -> str:
        """A path beside the file that is being read."""
        import xacro

        return str(xacro.abs_filename_spec(name))

    def yaml(self, name: str) -> Any:
        """Values of a YAML file; angles and lengths in the units that xacro knows."""
        import yaml

        units = {"radians": 1.0, "degrees": math.pi / 180.0, "meters": 1.0, "millimeters": 1e-3}
        units |= {"foot": 0.3048, "inches": 0.0254}

        class Loader(yaml.SafeLoader):  # type: ignore[misc]  # yaml has no types
            pass

        for unit, size in units.items():
            Loader.add_constructor(
                f"!{unit}",
                lambda loader, node, size=size: float(self.of_text(loader.construct_scalar(node), {})) * size,
            )
        if not name.endswith((".yaml", ".yml")):
            raise ValueError(f"expected a YAML file, found {name}")
        data = self.read(self.path(name))
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(data)):
            raise ValueError(f"{name}: anchors and aliases are not taken")
        return yaml.load(data, Loader)  # a SafeLoader

    def read(self, name: str) -> bytes:
        """The content of a file of the robot's package, or of one that it finds."""
        if not any(Path(name).resolve().is_relative_to(folder) for folder in self.folders):
            raise RobotError("this file lies outside the packages of this robot", file=name)
        return read_bytes(name, RobotError, limit_bytes=LARGEST_INCLUDE)

    def package(self, name: str) -> str:
        """The folder of a package: as given, above, beside or below the robot's file, or among ROS's and irbcal's."""
        if not _PACKAGE.fullmatch(name):
            raise ValueError(f"{name!r} is no name of a package")
        candidates = [folder / name for folder in self.arguments]
        candidates += [
            folder for folder in (*self.arguments, *self.above) if folder.name == name or _is_package(folder, name)
        ]
        candidates += [folder / name for folder in self.above]
        candidates += [Path(folder) / name for folder in robots.package_dirs()]
        for folder in candidates:
            if folder.is_dir() and folder.resolve().parent != Path(folder.anchor):  # $(find etc)
                self.folders.append(folder.resolve())
                return str(folder)
        raise ValueError(
            f"the package {name} is not beside this file: name the folder that holds it with --package-dir"
        )


def _is_package(folder: Path, name: str) -> bool:
    manifest = folder / "package.xml"
    if not manifest.is_file():
        return False
    data = read_bytes(manifest, RobotError, limit_bytes=LARGEST_INCLUDE)
    return re.search(rb"<name>\s*" + re.escape(name.encode()) + rb"\s*</name>", data) is not None


def bounded(value: Any) -> Any:
    """A value, if no number in it is too large, and its text not too long.

    Raises
    ------
    ValueError
        Otherwise.
    """
    if isinstance(value, int) and abs(value) >= LARGEST_NUMBER:
        raise ValueError("a whole number is too large")
    members = value.values() if isinstance(value, dict) else value if isinstance(value, (list, tuple)) else (value,)
    characters = 0
    for member in members:
        characters += len(str(member))  # of a member, which is bounded already
        if characters > LONGEST:
            raise ValueError("a value is too long")
    return value


def _named(name: str) -> Any:
    constants = {"pi": math.pi, "True": True, "False": False, "true": True, "false": False, "None": None}
    if name in constants:
        return constants[name]
    raise NameError(f"{name} is not defined")


def _member(value: Any, name: Any) -> Any:
    """A member of a mapping or a list."""
    if isinstance(value, (Mapping, list, tuple, str)):
        return value[name]
    raise ValueError(f"there is no member {name!r} of a {type(value).__name__}")


def _combined(op: type[ast.operator], a: Any, b: Any) -> Any:
    """Two values combined: numbers, or lists or texts put together."""
    numbers = isinstance(a, (int, float)) and isinstance(b, (int, float))
    joined = op is ast.Add and type(a) is type(b) and isinstance(a, (str, list)) and len(a) + len(b) <= LONGEST
    if not (numbers or joined) or op not in _BINARY:
        raise ValueError(f"irbcal does not compute {a!r} {op.__name__} {b!r}"[:150])
    return _BINARY[op](a, b)
