"""Results that speak: as text, as a table in a notebook, short in the interpreter."""

import importlib
import pkgutil
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest
from lxml import html

import irbcal
from irbcal.summary import UNITS, Content, Result, Table, as_text, rows

TABLE = Table(
    "Errors, mm", ("model", "points", "mean"), (("a<b", 3, 0.12345), ("[red]c", None, 2.0)), bold=frozenset({1})
)


class Sample(Result):
    def __init__(self, words):
        self.words = words

    def report(self):
        return [self.words, TABLE]


def test_numbers_have_their_digits_and_names_stay_as_they_are():
    text = as_text([TABLE, "Note: [bold]x"])
    assert "a<b" in text
    assert "[red]c" in text
    assert "0.123" in text
    assert "–" in text
    assert text.splitlines()[0] == "Errors, mm"
    assert text.splitlines()[-1] == "Note: [bold]x"


def test_numbers_stand_on_the_right():
    assert TABLE.on_the_right() == [False, True, True]
    rows = [line for line in as_text([TABLE]).splitlines() if "0.123" in line or "2.000" in line]
    assert len({line.rstrip().index(".") for line in rows}) == 1


def test_html_is_escaped_and_whole():
    page = Sample("<script>")._repr_html_()
    assert "<script>" not in page
    table = html.fragment_fromstring(page).find(".//table")
    assert [cell.text_content() for cell in table.findall(".//td")] == ["a<b", "3", "0.123", "[red]c", "–", "2.000"]


def test_a_long_headline_is_cut():
    assert repr(Sample("short")) == "<Sample: short>"
    assert len(repr(Sample("x" * 10_000))) < 2_000


WIDE = Table(
    "Wide",
    ("model placement", "note", *(f"angle of joint {k}" for k in range(9))),
    (("all targets of it", "free " * 12, *(123.456,) * 9),),
)


@pytest.mark.parametrize("width", [200, 110, 60, 20])
def test_numbers_are_never_broken(width):
    text = as_text([WIDE], width)
    assert text.count("123.456") == 9
    assert ("model placement" in text) == (width > 110)
    assert max(map(len, text.splitlines())) <= max(width, WIDE.narrowest())
    assert WIDE.narrowest() < 115


def test_words_are_not_broken_where_there_is_room():
    table = Table("T", ("", "model"), (("all targets", "model placement"),))
    assert "all targets  model placement" in as_text([table], 32)
    columns = ("", "model", "points", "mean", "sigma", "max", "mean+3σ", "rms")
    errors = Table("T", columns, (("all targets", "model placement", 81, *(0.835,) * 5),))
    assert "all targets  model placement" in as_text([errors], 80)


def test_zero_has_no_sign():
    assert Table("T", ("x",), ((-0.0001,), (-0.0,), (-0.0006,))).cells() == [["0.000"], ["0.000"], ["-0.001"]]


@dataclass(frozen=True, eq=False, repr=False)
class Declared(Sample):
    """A result whose names have units."""

    length: float
    places: np.ndarray
    limit_mm: float
    inner: object

    CONTENT = "length_mm angle_deg=length limit_mm below=inner.none.deeper sum_mm_s=places.sum hole=inner.hole"
    COLUMNS = "x_mm,turn_deg=places"


def test_declared_names_give_values_in_their_units():
    inner = SimpleNamespace(none=None, hole=float("nan"))
    result = Declared(0.25, np.array([[0.001, np.pi], [0.002, np.pi / 2]]), 3.0, inner)
    content = result.to_dict()
    assert content.pop("sum_mm_s") == pytest.approx(1000 * (0.003 + 1.5 * np.pi))
    assert content.pop("angle_deg") == pytest.approx(45 / np.pi)
    assert content == {"length_mm": 250.0, "limit_mm": 3.0, "below": None, "hole": None}
    frame = result.to_frame()
    assert list(frame) == ["x_mm", "turn_deg"]
    assert frame.to_numpy() == pytest.approx(np.array([[1.0, 180.0], [2.0, 90.0]]))
    assert rows({"a": result}, "name limit_mm") == [{"name": "a", "limit_mm": 3.0}]


@dataclass(frozen=True, eq=False, repr=False)
class Several(Sample):
    """A result with names that depend on what there is, and rows of several readings each."""

    numbers_mm: dict | None
    runs: dict

    CONTENT = "*numbers_mm first_mm?=first last?=numbers_mm"
    ROWS, COLUMNS = "runs", "run error_mm"
    first = None


def test_names_that_depend_on_what_there_is():
    runs = {"a": SimpleNamespace(error=np.array([0.001, 0.002])), "b": SimpleNamespace(error=np.array([0.003]))}
    assert Several({"x": 1}, runs).to_dict() == {"x": 1, "last": {"x": 1}}
    assert Several(None, runs).to_dict() == {}
    frame = Several(None, runs).to_frame()
    assert frame.to_dict("list") == {"run": ["a", "a", "b"], "error_mm": pytest.approx([1.0, 2.0, 3.0])}


class OnlyColumns(Sample):
    """A result that is no dataclass, and declares columns alone."""

    COLUMNS = "x_mm=position"
    position = np.array([0.001, 0.002])


class OnlyRows(Sample):
    """One whose rows are of things by name."""

    ROWS, COLUMNS = "runs", "run turn_deg=turn"
    runs: ClassVar = {"a": SimpleNamespace(turn=np.pi)}


def test_what_is_declared_serves_json_and_table():
    assert OnlyColumns("").to_dict() == {"x_mm": pytest.approx([1.0, 2.0])}
    assert OnlyRows("").to_dict() == {"runs": [{"run": "a", "turn_deg": pytest.approx(180.0)}]}
    frame = Named(0.25, {"below": {"count": 3}}).to_frame()
    assert frame.to_dict("records") == [{"length_mm": 250.0, "inner.below.count": 3}]


@dataclass(frozen=True, eq=False, repr=False)
class Named(Sample):
    """A result with content and no columns."""

    length: float
    inner: dict
    CONTENT = "length_mm inner"


CLASSES: dict[str, type] = {}
for module in pkgutil.walk_packages(irbcal.__path__, "irbcal."):
    if not module.name.endswith("__main__"):
        for name, item in vars(importlib.import_module(module.name)).items():
            if isinstance(item, type) and item.__module__.startswith("irbcal"):
                CLASSES.setdefault(name, item)
DECLARED = [kind for kind in CLASSES.values() if issubclass(kind, Content) and kind not in (Content, Result)]


def annotation_of(owner, name):
    """Of an attribute, or of what a property or method gives; empty where there is none."""
    for base in owner.__mro__:
        member = vars(base).get(name)
        function = getattr(member, "fget", None) or getattr(member, "func", None) or member
        annotations = getattr(base, "__annotations__", {})
        annotation = annotations.get(name) or getattr(function, "__annotations__", {}).get("return")
        if annotation is not None:
            return annotation if isinstance(annotation, str) else repr(annotation)
    return ""


def kind_of(owner, name):
    """Class of an attribute, or of what a container has; None where it is no class of irbcal."""
    return next((CLASSES[word] for word in re.findall(r"\w+", annotation_of(owner, name)) if word in CLASSES), None)


CONTAINERS = {
    **dict.fromkeys(("FloatArray", "IntArray", "BoolArray", "NameArray"), np.ndarray),
    **{kind.__name__: kind for kind in (pd.DataFrame, tuple, list, dict, Mapping, Sequence)},
}


def container_of(owner, name):
    """Class of an attribute that holds others; None where it holds none."""
    words = re.findall(r"\w+", annotation_of(owner, name).removeprefix("pd."))
    return CONTAINERS.get(words[0]) if words else None


def has(owner, attribute):
    return hasattr(owner, attribute) or any(attribute in getattr(base, "__annotations__", {}) for base in owner.__mro__)


def missing(owner, names):
    """Declared names whose attributes an owner does not have."""
    out = []
    for word in names.split():
        name, _, path = word.replace("*", "=").replace("?", "").partition("=")
        holder = owner
        before_unit = [name.partition(f"_{unit}")[0] for unit in UNITS]
        for attributes in [[part] for part in path.split(".")] if path else [[name, *before_unit]]:
            if holder is None or not any(has(holder, attribute) for attribute in attributes):
                out.append(word)
                break
            holder = container_of(holder, attributes[0]) or kind_of(holder, attributes[0])
    return out


def test_a_misspelt_word_of_a_container_is_missing():
    class Inner:
        error: list[float]

    assert missing(Inner, "count=error.__len__ last=error.pop") == []
    assert missing(Inner, "last=error.opp first=eror.pop part=error.pop.deeper") == [
        "last=error.opp",
        "first=eror.pop",
        "part=error.pop.deeper",
    ]


@pytest.mark.parametrize("kind", DECLARED, ids=lambda kind: kind.__name__)
def test_declared_names_are_those_of_the_result(kind):
    content, columns = (getattr(kind, name, "") for name in ("CONTENT", "COLUMNS"))
    of_rows = getattr(kind, "ROWS", "")
    rows_of = kind_of(kind, of_rows) if of_rows else kind
    if annotation_of(kind, of_rows).startswith(("dict", "Mapping")):
        columns = columns.partition(" ")[2]  # the first is what the holder is called
    assert missing(kind, f"{content} {of_rows}") == []
    assert missing(rows_of, columns) == []
    for names in (content, columns):
        keys = [key for word in names.split() for key in word.partition("=")[0].split(",")]
        assert len(keys) == len(set(keys))


LISTED = [kind for kind in CLASSES.values() if is_dataclass(kind) and "Attributes\n    ---" in kind.__doc__]


@pytest.mark.parametrize("kind", LISTED, ids=lambda kind: kind.__name__)
def test_attributes_that_help_lists_are_there(kind):
    listed = re.split(r"Attributes\n    -+\n", kind.__doc__)[1].split("\n\n")[0]
    names = [name for line in re.findall(r"^    (\w+(?:, \w+)*) :", listed, re.M) for name in line.split(", ")]
    assert [name for name in names if not has(kind, name)] == []
