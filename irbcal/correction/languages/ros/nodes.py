"""YAML as nodes: values with the places in the text where they stand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import yaml

from irbcal.correction.listing import Number
from irbcal.errors import ProgramError

Node: TypeAlias = "yaml.Node"
LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def document(text: str, source: str) -> yaml.Node:
    """The one document of a text.

    Raises
    ------
    ProgramError
        If the text is no YAML, or holds none or several documents.
    """
    try:
        found = [node for node in yaml.compose_all(text, Loader=LOADER) if node is not None and not _is_null(node)]
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or "it cannot be read"
        line = None if mark is None else int(mark.line) + 1
        raise ProgramError(f"this is no YAML: {problem}", file=source, line=line) from None
    except RecursionError:
        raise ProgramError("this is no trajectory: its lists are nested too deep", file=source) from None
    if len(found) != 1:
        raise ProgramError(f"expected one trajectory, found {len(found)} YAML documents", file=source)
    return found[0]


def _is_null(node: yaml.Node) -> bool:
    return isinstance(node, yaml.ScalarNode) and not node.value.strip()


def line(node: yaml.Node) -> int:
    """Line of a node, from 1."""
    return int(node.start_mark.line) + 1


class Reader:
    """Takes nodes for what they should be; refusals name the file and the line."""

    def __init__(self, source: str) -> None:
        self.source = source

    def error(self, node: yaml.Node, message: str) -> ProgramError:
        """A refusal of a node."""
        return ProgramError(message, file=self.source, line=line(node))

    def mapping(self, node: yaml.Node, what: str) -> dict[str, yaml.Node]:
        """Values by their keys."""
        if not isinstance(node, yaml.MappingNode):
            raise self.error(node, f"expected {what} with names and values")
        found: dict[str, yaml.Node] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else ""
            if name in found:
                raise self.error(key, f"{name} stands here a second time")
            found[name] = value
        return found

    def items(self, node: yaml.Node, what: str) -> Sequence[yaml.Node]:
        """The items of a list."""
        if not isinstance(node, yaml.SequenceNode):
            raise self.error(node, f"expected {what} as a list")
        return list(node.value)

    def text(self, node: yaml.Node, what: str) -> str:
        """A word."""
        if not isinstance(node, yaml.ScalarNode):
            raise self.error(node, f"expected {what}")
        return str(node.value)

    def number(self, node: yaml.Node, what: str) -> Number:
        """A finite number with its place in the text."""
        shown = self.text(node, what)
        try:
            value = float(shown) if shown.isascii() and "_" not in shown else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(node, f"expected {what} as a finite number, found {shown[:40]!r}")
        return Number(value, int(node.start_mark.index), int(node.end_mark.index))
