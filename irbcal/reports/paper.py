"""What the pages of this room share: templates that escape what comes from data, and how numbers are shown."""

from __future__ import annotations

from typing import TYPE_CHECKING

from irbcal.plotting import charts
from irbcal.plotting.charts import fixed

if TYPE_CHECKING:
    from jinja2 import Template

DIGITS = {"mm": 3, "deg": 4, "rad": 6, "1": 6}


def template(name: str) -> Template:
    """A template of this room by the name of its file; what is put into it is escaped, and nothing may be missing."""
    from irbcal.templates import environment as templates

    environment = templates("irbcal.reports")
    environment.filters |= {"fixed": fixed, "unit": in_unit, "std": deviation, "count": count, "svg": charts.inline}
    environment.filters |= {"repr": repr, "short": short, "file_name": file_name}
    return environment.get_template(name)


def in_unit(value: float, unit: str) -> str:
    """A number with the decimals of its unit."""
    return fixed(value, DIGITS[unit]) if unit in DIGITS else format(value, ".6g")


def deviation(value: float | None, unit: str) -> str:
    """A standard deviation, also one that is too small to show, or none."""
    if value is None:
        return "–"
    smallest = 10.0 ** -DIGITS.get(unit, 6)
    return f"< {in_unit(smallest, unit)}" if value < smallest / 2 else in_unit(value, unit)


def count(n: int, noun: str) -> str:
    """A number of things in words."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def file_name(path: str) -> str:
    """The name of a file without its folders: a page that is handed on must not tell how a disk is laid out."""
    return path.replace("\\", "/").rstrip("/").rpartition("/")[2] or path


def short(text: str, limit: int = 28) -> str:
    """A name from data that must not fill a page: its beginning and its end."""
    return text if len(text) <= limit else f"{text[: limit // 2]}…{text[-(limit // 2 - 1) :]}"
