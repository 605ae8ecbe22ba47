"""Files of maps: the presets that ship with the package, and maps of one's own.

A map is a small YAML file. The presets are maps too: copy one and change it.
"""

import difflib
import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from irbcal.errors import MeasurementError
from irbcal.measurement.imports.column_map import ImportMap
from irbcal.reading import read_bytes

PRESETS = Path(__file__).parent / "presets"
LARGEST_MAP = 64 * 1024
"""Bytes of a map file."""

Map = TypeVar("Map", bound=BaseModel)

Changes: TypeAlias = Mapping[str, Any] | Sequence[str]
"""Changes of a map: ``{"units.lengths": "mm"}`` or ``["units.lengths=mm"]``."""


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # yaml has no types
    """Plain YAML only: no anchors (which can blow up), no key twice (of which one would be lost)."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            mark = event.start_mark
            raise yaml.MarkedYAMLError(problem="anchors and aliases are not taken", problem_mark=mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        keys = [key.value for key, _ in node.value]
        double = [key for key, _ in node.value if keys.count(key.value) > 1]
        if double:
            raise yaml.MarkedYAMLError(
                problem=f"{double[1].value!r} stands there twice", problem_mark=double[1].start_mark
            )
        return super().construct_mapping(node, deep)


def presets() -> list[str]:
    """Names of the shipped presets."""
    return sorted(path.stem for path in PRESETS.glob("*.yaml"))


def preset_text(name: str) -> str:
    """The YAML text of a preset.

    Raises
    ------
    MeasurementError
        If there is none of this name; the sentence lists those that are there.
    """
    if name not in presets():
        near = difflib.get_close_matches(name, presets(), n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise MeasurementError(f"{name}: expected a preset ({', '.join(presets())}) or a map file (.yaml){hint}")
    return (PRESETS / f"{name}.yaml").read_text(encoding="utf-8")


def read_map(name: str | PathLike[str], changes: Changes = ()) -> ImportMap:
    """Read a preset or a map file.

    Parameters
    ----------
    name : str or Path
        Name of a preset, or path of a YAML file.
    changes : dict, or sequence of str
        Values by the place of their key, written with dots, such as ``{"units.lengths": "mm"}``; or texts
        ``key=value`` with the value in YAML, such as ``units.lengths=mm``.

    Raises
    ------
    MeasurementError
        If there is no such map or it is not one; the sentence names the file and the key.
    """
    values, source = values_of(name, changes)
    return validated(ImportMap, values, source)


def values_of(name: str | PathLike[str], changes: Changes = ()) -> tuple[dict[str, Any], str]:
    """What a preset or map file says, changed, and its name for messages; parameters and errors as `read_map`."""
    source = str(name)
    if source in presets() or (Path(source).suffix.lower() not in (".yaml", ".yml") and not Path(source).is_file()):
        text, source = preset_text(source), f"preset {source}"
    else:
        text = _read_text(source)
    return changed(text, source, changes), source


def changed(text: str, source: str, changes: Changes) -> dict[str, Any]:
    """A map in YAML as keys and values, with changes; errors as `read_map`."""
    values = _yaml(text, source)
    if not isinstance(values, dict):
        raise MeasurementError(f"expected keys and values such as 'columns:', found {_short(values)}", file=source)
    if isinstance(changes, Mapping):
        for key, value in changes.items():
            _put(values, key.split("."), value, key)
    else:
        for change in changes:
            _change(values, change)
    return values


def validated(model: type[Map], values: Mapping[str, Any], source: str) -> Map:
    """Keys and values as a map of a kind; errors as `read_map`."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise MeasurementError(_sentence(error, model), file=source) from None


def _read_text(source: str) -> str:
    data = read_bytes(source, MeasurementError, limit_bytes=LARGEST_MAP)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data[: error.start].count(b"\n") + 1
        raise MeasurementError("expected UTF-8 text, found other bytes", file=source, row=row) from None


def _yaml(text: str, source: str) -> Any:
    try:
        return yaml.load(text, Loader=_Loader)  # a child of SafeLoader
    except yaml.MarkedYAMLError as error:
        row = error.problem_mark.line + 1 if error.problem_mark else None
        raise MeasurementError(f"not a map in YAML: {error.problem}", file=source, row=row) from None
    except (yaml.YAMLError, ValueError, TypeError) as error:
        raise MeasurementError(f"not a map in YAML: {' '.join(str(error).split())}", file=source) from None
    except RecursionError:
        raise MeasurementError("not a map in YAML: nested too deeply", file=source) from None


def _change(values: dict[str, Any], change: str) -> None:
    key, equals, text = change.partition("=")
    steps = key.strip().split(".")
    if not equals or not all(steps):
        raise MeasurementError(f"--set {change}: expected key=value such as units.lengths=mm", parameter="set")
    if len(text) > LARGEST_MAP:
        raise MeasurementError(f"--set {key}: expected at most {LARGEST_MAP // 1024} KiB, found more", parameter="set")
    # a lone , ; or | is no YAML, but it is what one wants to say here
    value = text if text in (",", ";", "|", "\t") else _yaml(text, f"--set {key}")
    _put(values, steps, value, change)


def _put(values: dict[str, Any], steps: Sequence[str], value: Any, change: str) -> None:
    """Put a value where the steps lead, in place."""
    for step in steps[:-1]:
        inner = values.get(step)
        if inner is None:
            inner = values[step] = {}
        if not isinstance(inner, dict):
            raise MeasurementError(f"--set {change}: {step} is no group of keys", parameter="set")
        values = inner
    values[steps[-1]] = value


def _sentence(error: ValidationError, model: type[BaseModel]) -> str:
    """The first fault in a map, with its place."""
    fault = min(error.errors(include_url=False), key=lambda entry: entry["type"] != "extra_forbidden")
    path = [str(step) for step in fault["loc"] if not re.search(r"[\[(]|^(str|int|list|dict|literal)$", str(step))]
    key = ".".join(map(_plain, path)) or "the map"
    if fault["type"] == "extra_forbidden":
        key, path = str(fault["loc"][-1]), [str(step) for step in fault["loc"][:-1]]
        keys = _keys(path, model)
        near = difflib.get_close_matches(key, keys, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(keys)}" if keys else "it is unknown"
        return f"{'.'.join([*path, _plain(key)])}: there is no such key; {hint}"
    if fault["type"] == "missing":
        return f"{key}: expected this key, found nothing"
    text = fault["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    text = re.sub(r"a valid dictionary( or instance of \w+)?", "a group of keys", text)
    text = re.sub(r"^(?:List|Dictionary|String) should (?:have )?|after validation, not \d+", "", text).strip()
    if fault["type"] == "value_error":
        return text if key == "the map" else f"{key}: {text}" + ("" if "found" in text else f", found {_value(fault)}")
    return f"{key}: expected {text[:1].lower() + text[1:]}, found {_value(fault)}"


def _plain(text: str) -> str:
    """Text from a map for a sentence: short, and on one line."""
    return _short(text) if len(text) > 40 or not text.isprintable() else text


def _keys(path: Sequence[str], model: type[BaseModel]) -> list[str]:
    """Keys that a part of the map may have."""
    for step in path:
        inner = model.model_fields.get(step)
        kinds = [] if inner is None else [inner.annotation, *getattr(inner.annotation, "__args__", ())]
        models = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]
        if not models:
            return []
        model = models[0]
    return list(model.model_fields)


def _value(fault: Mapping[str, Any]) -> str:
    return _short(fault["input"])


def _short(value: Any) -> str:
    if value is None:
        return "nothing"
    text = repr(value)
    return text if len(text) <= 60 else text[:60] + "…"
