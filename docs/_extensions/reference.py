"""Pages that are made of the program itself: commands with their options, public functions and classes."""

from __future__ import annotations

import ast
import inspect
import json
import re
from enum import Enum
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

GENERATED = Path(__file__).parents[1] / "_generated"


def commands() -> str:
    """Markdown of all commands with their options."""
    from typer.main import get_command

    from irbcal.cli.main import app

    group = get_command(app)
    parts = ["# Commands", ""]
    for name, command in group.commands.items():
        if not command.hidden:
            parts += [f"## irbcal {name}", "", _plain(command.help or ""), "", *_options(command), ""]
    return "\n".join(parts)


def _plain(text: str) -> str:
    return inspect.cleandoc(text).replace("<", "&lt;")


def _options(command: Any) -> list[str]:
    rows = ["| | | default |", "| --- | --- | --- |"]
    for parameter in command.params:
        names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts) if name != "--help")
        if parameter.param_type_name == "argument":
            names = f"`{(parameter.metavar or parameter.name).upper()}`"
        choices = _choices(parameter.type_descriptor.annotation)
        words = _plain(getattr(parameter, "help", None) or "").replace("|", "\\|")
        if choices:
            words += " One of " + ", ".join(f"`{choice}`" for choice in choices) + "."
        shown = getattr(parameter, "show_default", False)
        default = shown if isinstance(shown, str) else parameter.default if shown else None
        default = getattr(default, "value", default)
        rows.append(f"| {names} | {words} | {'' if default in (None, False, ()) else default} |")
    return rows


def _choices(annotation: Any) -> list[str]:
    """Values of a Literal or an Enum."""
    if inspect.isclass(annotation) and issubclass(annotation, Enum):
        return [str(item.value) for item in annotation]
    return [str(value) for value in get_args(annotation)] if get_origin(annotation) is Literal else []


def api() -> str:
    """Markdown of all public names, by the stub of the package."""
    import irbcal

    stub = ast.parse((Path(irbcal.__file__).parent / "__init__.pyi").read_text(encoding="utf-8"))
    names = [
        (f"irbcal.{node.module}", alias.name, alias.asname or alias.name)
        for node in stub.body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    ]
    functions = [row for row in names if inspect.isfunction(getattr(irbcal, row[2]))]
    classes = [row for row in names if inspect.isclass(getattr(irbcal, row[2]))]
    parts = ["# Python reference", "", "Metres and radians; files and tables say their units in their columns.", ""]
    for title, rows, kind, more in (
        ("Functions", functions, "autofunction", ""),
        ("Classes", classes, "autoclass", ":members:\n"),
    ):
        parts += [f"## {title}", ""]
        for name in sorted(row[2] for row in rows):
            parts += ["```{eval-rst}", f".. {kind}:: irbcal.{name}", *([f"   {more}"] if more else []), "```", ""]
    return "\n".join(parts)


def schema() -> str:
    """JSON Schema of calibration.json."""
    from irbcal.io.schema import Record

    return json.dumps(Record.model_json_schema(), indent=1)


def import_map() -> str:
    """Markdown of all keys of an import map, by its schema."""
    from irbcal.measurement.imports.column_map import ImportMap

    whole = ImportMap.model_json_schema()
    parts = ["# Keys of an import map", "", "Of `irbcal import`, in YAML; or one by one: `--set file.decimal=,`.", ""]
    parts += _keys("", whole, whole["$defs"])
    return "\n".join(parts)


def _keys(prefix: str, schema: dict[str, Any], definitions: dict[str, Any]) -> list[str]:
    text = inspect.cleandoc(schema.get("description", "")).replace("``", "`").split("Attributes\n")[0].strip()
    attributes = inspect.cleandoc(schema.get("description", "")).partition("Attributes\n----------\n")[2]
    rows, inner = ["| key | value | default |", "| --- | --- | --- |"], []
    for name, field in schema["properties"].items():
        kinds = [_kind(kind, definitions) for kind in field.get("anyOf", [field])]
        groups = [ref for kind in field.get("anyOf", [field]) if (ref := _group(kind)) is not None]
        about = re.search(rf"^{name}(?:, \w+)* : .*\n((?:    .*\n?)*)", attributes, re.MULTILINE)
        words = "; ".join(kind for kind in dict.fromkeys(kinds) if kind != "nothing")
        words += f". {' '.join(about[1].split())}" if about and about[1].strip() else ""
        default = field.get("default")
        shown = "" if default in (None, "", {}, []) or isinstance(default, dict) else f"`{json.dumps(default)}`"
        rows.append(f"| `{prefix}{name}` | {words.replace('|', chr(92) + '|').replace('``', '`')} | {shown} |")
        for group in groups:
            inner += ["", f"## {prefix}{name}", "", *_keys(f"{prefix}{name}.", definitions[group], definitions)]
    return [text, "", *rows, *inner]


def _group(kind: dict[str, Any]) -> str | None:
    """The part of a schema that a value refers to, itself or each of a list."""
    reference = kind.get("$ref") or (kind.get("items") or {}).get("$ref")
    return reference.rpartition("/")[2] if reference else None


def _kind(kind: dict[str, Any], definitions: dict[str, Any]) -> str:
    """A value's kind in words."""
    if "$ref" in kind:
        return "keys below"
    if "enum" in kind:
        return "one of " + ", ".join(f"`{json.dumps(value)}`" for value in kind["enum"])
    if "const" in kind:
        return f"`{json.dumps(kind['const'])}`"
    if "anyOf" in kind:
        return " or ".join(dict.fromkeys(_kind(one, definitions) for one in kind["anyOf"]))
    if kind.get("type") == "array":
        return f"list of {_kind(kind.get('items', {}), definitions)}"
    if kind.get("type") == "object":
        values = [kind.get("additionalProperties"), *kind.get("patternProperties", {}).values()]
        return f"`name: value` with {_kind(next(filter(None, values), {}), definitions)}"
    names = {"string": "text", "integer": "whole number", "number": "number", "boolean": "`true` or `false`"}
    return names.get(kind.get("type", ""), "nothing" if kind.get("type") == "null" else "column, by name or number")


def write(app: Any) -> None:
    """Write them where they changed."""
    GENERATED.mkdir(exist_ok=True)
    pages = {"commands.md": commands(), "api.md": api(), "calibration.schema.json": schema()}
    pages["import-map.md"] = import_map()
    for name, text in pages.items():
        path = GENERATED / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """For Sphinx."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True}
