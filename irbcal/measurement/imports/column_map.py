"""The map of a foreign file: which of its columns mean what, in which units.

Units are declared in the map or the import is refused; nothing about them is guessed.
"""

from __future__ import annotations

import codecs
import difflib
import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    model_validator,
)

from irbcal.errors import MeasurementError
from irbcal.option_values import excerpt
from irbcal.safe_files import read_bytes

RESERVED = (
    *("pose", "pose_index", "row", "target", "group", "cycle", "session", "x_mm", "y_mm", "z_mm"),
    *("qw", "qx", "qy", "qz", "u95_mm", "time_s", "payload_kg"),
)
"""Columns of a measurement file that are not to be kept from elsewhere."""
OWN_COLUMNS = {
    "group": "group",
    "cycle": "cycle",
    "session": "session",
    "time": "time_s",
    "u95": "u95_mm",
    "payload": "payload_kg",
}
"""Keys of a map's columns, and the names of these columns in a measurement file."""
FIELDS = ("pose", "target", "group", "cycle", "ignore")
"""What a name pattern such as ``{pose}_{target}`` may hold."""


def _column(value: Any) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int):
        raise ValueError("expected a column's name (in quotes if it reads as yes, no, on or off) or its number")
    if value == 0:
        raise ValueError("columns are numbered from 1, or from -1 backwards")
    return value


Column: TypeAlias = Annotated[str | int, BeforeValidator(_column)]
ColumnName: TypeAlias = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")
]
Comment: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=100)]
ThreeColumns: TypeAlias = Annotated[list[Column], Field(min_length=3, max_length=3)]
JointUnit: TypeAlias = Literal["deg", "rad", "mm", "m", "inch"]
AngleUnit: TypeAlias = Literal["deg", "rad"]
LengthUnit: TypeAlias = Literal["mm", "m", "inch"]


class _MapModel(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


def _codec(name: str) -> str:
    try:
        if name == "auto" or codecs.lookup(name)._is_text_encoding:
            return name
    except LookupError:
        pass
    raise ValueError("expected auto, or an encoding of Python such as utf-8, cp1252, gbk, shift_jis")


class Dialect(_MapModel):
    """How a file is cut into cells.

    ``sheet`` is one of a workbook, or a file in a zip archive. ``encoding`` is one of Python's; ``auto`` is UTF-8, or
    what a byte order mark says. ``delimiter: auto`` looks for tabs, semicolons, bars, commas and blanks, in this order;
    ``fixed`` cuts lines at ``starts``, numbers of characters from 0. ``decimal: auto`` takes a comma only where it can
    be nothing else, and ``thousands`` is a mark between the digits of large
    numbers. Lines that begin with ``comment``, one text or several, are left out. A header may have
    ``title_rows`` rows (a title above others holds until the next one), and a row of units below. ``axis`` names the
    column that says X, Y or Z where three rows are a point: their columns then stand in one row, as ``NAME X`` ….
    Cells such as ``X=12.5`` or ``12.5 mm`` are numbers, whose unit is as one in the header.
    """

    sheet: Annotated[str, StringConstraints(min_length=1, max_length=200)] | None = None
    encoding: Annotated[str, StringConstraints(max_length=40), AfterValidator(_codec)] = "auto"
    delimiter: Literal["auto", ",", ";", "\t", "|", "tab", "space", "fixed"] = "auto"
    starts: Annotated[list[Annotated[int, Field(ge=0, le=10_000)]], Field(max_length=2000)] = []
    decimal: Literal["auto", ".", ","] = "."
    thousands: Literal["", "'", ",", ".", " "] = ""
    axis: Column | None = None
    comment: Comment | Annotated[list[Comment], Field(max_length=50)] | None = None
    skip_rows: Annotated[int, Field(ge=0, le=10_000)] = 0
    header: bool = True
    title_rows: Annotated[int, Field(ge=1, le=5)] = 1
    units_row: bool = False

    @property
    def comments(self) -> tuple[str, ...]:
        """What lines that are left out begin with."""
        return (self.comment,) if isinstance(self.comment, str) else tuple(self.comment or ())


class Columns(_MapModel):
    """Columns by name, or by number from 1 (from -1 backwards).

    In place of position and orientation, ``transform`` names the 12 or 16 columns of a matrix, row by row.
    ``position`` is three columns, or three for each of several targets that share a row. ``name`` is one column or
    several (joined with ``::``) that ``names`` takes apart. ``programmed`` are the joints that the program asked for,
    where ``joints`` are readings: in the units and by the rules of the joints. ``keep`` hands columns on under new
    names, ``others`` all columns that have no other use, under their own names. ``optional`` lists those that are used
    only where the file has them.
    """

    position: ThreeColumns | dict[ColumnName, ThreeColumns]
    joints: Annotated[list[Column], Field(min_length=1, max_length=20)] | None = None
    programmed: Annotated[list[Column], Field(min_length=1, max_length=20)] | None = None
    orientation: Annotated[list[Column], Field(min_length=3, max_length=9)] | None = None
    pose: Column | None = None
    target: Column | None = None
    name: Annotated[list[Column], Field(min_length=1, max_length=5)] | None = None
    group: Column | None = None
    cycle: Column | None = None
    session: Column | None = None
    time: Column | None = None
    u95: Column | None = None
    payload: Column | None = None
    keep: Annotated[dict[ColumnName, Column], Field(max_length=50)] = {}
    others: bool = False
    optional: list[
        Literal["programmed", "orientation", "target", "group", "cycle", "session", "time", "u95", "payload"]
    ] = []


class DeclaredColumns(Columns):
    """Some of the columns, as a user declares them."""

    position: ThreeColumns | dict[ColumnName, ThreeColumns] | None = None  # type: ignore[assignment]


class Units(_MapModel):
    """Units of the file: joints (one unit, or one for each joint), lengths, angles of an orientation, time."""

    joints: JointUnit | list[JointUnit] | None = None
    lengths: LengthUnit | None = None
    angles: AngleUnit | None = None
    time: Literal["s", "ms", "iso"] | None = None


class OrientationColumns(_MapModel):
    """What the numbers of an orientation mean.

    ``quaternion`` needs ``scalar``; ``euler`` needs ``axes`` (the order of the turns and of the columns) and ``about``
    (``moving``: each turn about the axes as turned so far; ``fixed``: about those of the tracker); ``ur`` is a
    rotation vector in radians; ``matrix`` is nine columns, row by row. ``maps`` says which coordinates the rotation
    turns into which.
    """

    kind: Literal["quaternion", "euler", "rotation-vector", "ur", "matrix"] | None = None
    scalar: Literal["first", "last"] | None = None
    axes: Annotated[str, StringConstraints(pattern=r"^[xyz]{3}$")] | None = None
    about: Literal["moving", "fixed"] | None = None
    maps: Literal["target-to-tracker", "tracker-to-target"] = "target-to-tracker"

    @model_validator(mode="after")
    def _axes_turn(self) -> OrientationColumns:
        if self.axes and (self.axes[0] == self.axes[1] or self.axes[1] == self.axes[2]):
            raise ValueError(f"expected two different axes after one another, found {self.axes!r}")
        return self


class Status(_MapModel):
    """A column that says whether a row's point was measured; other values than ``good`` mean that it is lost."""

    column: Column
    good: Annotated[list[str | int], Field(min_length=1)]


class Lost(_MapModel):
    """Cells that stand for a lost point, as text or number; an empty position and 0,0,0 always do."""

    markers: Annotated[list[str | int | float], Field(max_length=50)] = []
    status: Status | None = None

    @property
    def texts(self) -> list[str]:
        """Spellings of the marks, in lower case."""
        return [str(marker).strip().lower() for marker in self.markers]


class JointRules(_MapModel):
    """From readings to irbcal's joints: ``sign * (reading + readings of the joints in add) + offset``.

    ``add: {3: 2}`` adds joint 2 to joint 3, ``add: {3: -2}`` takes it away.
    """

    signs: list[Literal[1, -1]] | None = None
    offsets_deg: list[float] | None = None
    add: dict[int, int] = {}


class GroupRule(_MapModel):
    """A group for poses by name (``*`` stands for anything) or by number in the order of the file, from 1."""

    group: ColumnName
    poses: ColumnName | None = None
    first: Annotated[int, Field(ge=1)] | None = None
    last: Annotated[int, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _chooses(self) -> GroupRule:
        if (self.poses is None) == (self.first is None and self.last is None):
            raise ValueError("expected either poses (a name such as 'ISO_*'), or first and last")
        return self


class Fixed(_MapModel):
    """Values that the file does not hold."""

    target: ColumnName | None = None
    group: ColumnName | None = None
    payload_kg: Annotated[float, Field(ge=0)] | None = None
    u95_mm: Annotated[float, Field(gt=0)] | None = None


class JointsFileColumns(_MapModel):
    """Columns of the joints file; ``programmed`` as in `Columns`.

    With ``target``, the file has a row for each point; its targets are those of the points that have none themselves.
    """

    joints: Annotated[list[Column], Field(min_length=1, max_length=20)]
    programmed: Annotated[list[Column], Field(min_length=1, max_length=20)] | None = None
    pose: Column | None = None
    group: Column | None = None
    target: Column | None = None


class JointsFileUnits(_MapModel):
    """Units of the joints file."""

    joints: JointUnit | list[JointUnit]


class JointsFile(_MapModel):
    """A joints file that is not in irbcal's own format."""

    file: Dialect = Dialect()
    columns: JointsFileColumns
    units: JointsFileUnits


class ImportMap(_MapModel):
    """All that is to be known about a foreign file. See the presets for examples."""

    about: str = ""
    """For people."""
    file: Dialect = Dialect()
    columns: Columns
    units: Units = Units()
    orientation: OrientationColumns = OrientationColumns()
    lost: Lost = Lost()
    joints: JointRules = JointRules()
    names: Annotated[list[ColumnName], Field(max_length=10)] = []
    """Patterns such as ``{pose}_{target}`` for ``columns.name``; the first that fits all names is used, else for each
    name the first that fits it. ``{target=K}`` takes only what begins with K."""
    file_name: ColumnName | None = None
    """Pattern for the name of each source without its ending, such as ``{target}``."""
    pose_by: Literal["row", "joints", "target"] = "row"
    """Without a pose column: each row is a pose, neighbouring rows with the same joints are one, or the rows of a
    target are one pose after the other."""
    join: Literal["name", "number", "order"] | None = None
    """How a joints file is joined: by the poses' names, by the last number in them, or by order; None: by name where
    the source names its poses, else by order."""
    rename: dict[ColumnName, ColumnName] = {}
    """New names of targets; those that begin with ``ref`` are fixed to the floor."""
    groups: Annotated[list[GroupRule], Field(max_length=200)] = []
    """The first that fits a pose names its group."""
    fixed: Fixed = Fixed()
    joints_file: JointsFile | None = None
    trust_units: bool = False
    """Take the declared units even where the numbers look like others."""

    @property
    def names_poses(self) -> bool:
        """Whether the source gives its poses names."""
        patterns = [*self.names, self.file_name or ""]
        return self.columns.pose is not None or any(has_field(text, "pose") for text in patterns)

    @model_validator(mode="before")
    @classmethod
    def _transform_is_position_and_orientation(cls, values: Any) -> Any:
        """``columns.transform``, a 3 x 4 or 4 x 4 matrix row by row, as position and orientation."""
        columns = values.get("columns") if isinstance(values, dict) else None
        if not isinstance(columns, dict) or columns.get("transform") is None:
            return values
        matrix = columns["transform"]
        if not isinstance(matrix, list) or len(matrix) not in (12, 16):
            raise ValueError("columns.transform: expected 12 or 16 columns, the rows of a matrix one after the other")
        others_ = {key: value for key, value in columns.items() if key != "transform"}
        others_ |= {"position": matrix[3:12:4], "orientation": [matrix[k] for k in range(12) if k % 4 != 3]}
        orientation = values.get("orientation") or {}
        return {
            **values,
            "columns": others_,
            "orientation": {"kind": "matrix", **orientation} if isinstance(orientation, dict) else orientation,
        }

    @model_validator(mode="after")
    def _one_orientation_for_one_target(self) -> ImportMap:
        if isinstance(self.columns.position, dict) and self.columns.orientation:
            raise ValueError("columns.orientation: expected one target in a row, found positions of several")
        return self

    @model_validator(mode="after")
    def _as_many_programmed_joints(self) -> ImportMap:
        check_programmed("columns", self.columns.joints, self.columns.programmed)
        if self.joints_file is not None:
            columns = self.joints_file.columns
            check_programmed("joints_file.columns", columns.joints, columns.programmed)
        return self

    @model_validator(mode="after")
    def _kept_columns_are_new(self) -> ImportMap:
        reserved = [name for name in self.columns.keep if name in RESERVED or re.fullmatch(r"[qc]\d+_(deg|mm)", name)]
        if reserved:
            raise ValueError(
                f"columns.keep: expected a new name for the column, found {reserved[0]!r}, which has a meaning"
            )
        return self

    @model_validator(mode="after")
    def _patterns_are_known(self) -> ImportMap:
        for pattern in [*self.names, *([self.file_name] if self.file_name else [])]:
            pattern_regex(pattern)
        if bool(self.columns.name) != bool(self.names):
            raise ValueError("columns.name and names (patterns such as '{pose}_{target}') belong together")
        return self


def check_programmed(key: str, joints: Sequence[Column] | None, programmed: Sequence[Column] | None) -> None:
    """Refuse, as a `ValueError`, columns of programmed joints that are not as many as those of joints."""
    if programmed and len(programmed) != len(joints or ()):
        raise ValueError(
            f"{key}.programmed: expected a column for each of the {len(joints or ())} columns of joints, found "
            f"{len(programmed)}"
        )


def has_field(pattern: str, name: str) -> bool:
    """Whether a name pattern has a field, with or without what it begins with."""
    return re.search(rf"\{{{name}[=}}]", pattern) is not None


def pattern_regex(pattern: str) -> str:
    """Regular expression of a name pattern: fields in braces, all else as it stands; no field holds ``::``.

    ``{pose=P}`` is a field that begins with P.

    Raises
    ------
    ValueError
        If a field is unknown, stands there twice or touches another one that may begin with anything.
    """
    pieces = re.split(r"\{([^{}]*)\}", pattern)
    fields = [text.partition("=") for text in pieces[1::2]]
    strange = [name for name, _, _ in fields if name not in FIELDS]
    if strange or not 1 <= len(fields) <= len(FIELDS):
        problem = f"{{{strange[0]}}}" if strange else pattern
        raise ValueError(f"expected a pattern of {', '.join(f'{{{name}}}' for name in FIELDS)}, found {problem!r}")
    names = [name for name, _, _ in fields]
    double = [name for name in names if name != "ignore" and names.count(name) > 1]
    if double or any(
        piece == "" and not start for piece, (_, _, start) in zip(pieces[2:-1:2], fields[1:], strict=True)
    ):
        raise ValueError(f"expected each field once with something between the fields, found {pattern!r}")
    text = re.escape(pieces[0])
    for (name, _, start), literal in zip(fields, pieces[2::2], strict=True):
        text += ("(" if name == "ignore" else f"(?P<{name}>") + re.escape(start) + "(?:(?!::).)+)" + re.escape(literal)
    return text


PRESETS = Path(__file__).parent / "presets"
LARGEST_MAP = 64 * 1024
"""Bytes of a map file."""

Map = TypeVar("Map", bound=BaseModel)

Changes: TypeAlias = Mapping[str, Any] | Sequence[str]
"""Changes of a map: ``{"units.lengths": "mm"}`` or ``["units.lengths=mm"]``."""


class _PlainLoader(yaml.SafeLoader):  # type: ignore[misc]  # yaml has no types
    """Plain YAML only: no anchors (which can blow up), no key twice (of which one would be lost)."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """A node, unless it is an alias or has an anchor."""
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            mark = event.start_mark
            raise yaml.MarkedYAMLError(problem="anchors and aliases are not taken", problem_mark=mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """A mapping, unless a key stands twice."""
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
        return yaml.load(text, Loader=_PlainLoader)  # a child of SafeLoader
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
        return (
            text
            if key == "the map"
            else f"{key}: {text}" + ("" if "found" in text else f", found {_short(fault['input'])}")
        )
    return f"{key}: expected {text[:1].lower() + text[1:]}, found {_short(fault['input'])}"


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


def _short(value: Any) -> str:
    return "nothing" if value is None else excerpt(value)
