"""What names of points tell: the pose, the target, or both."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from irbcal.measurement.imports.column_map import pattern_regex
from irbcal.measurement.imports.column_roles import Roles
from irbcal.measurement.imports.sheets import Sheet, without_digits

_SEPARATORS = ("_", "-", "@", "/", " ", ".", ":")

MOST_TARGETS = 20


class PointLabels(NamedTuple):
    """Keys of the map that name poses and targets, and the poses that they give (none: None)."""

    keys: dict[str, Any]
    poses: list[str] | None


def point_labels(sheet: Sheet, roles: Roles, poses: int | None) -> Iterator[PointLabels]:
    """How the rows of a table are named, the likeliest first; ``poses`` where their number is known."""
    table = sheet.table
    text = {k: table.text(k).tolist() for k in roles.labels}
    text = {k: values for k, values in text.items() if len(set(values)) > 1 or len(values) == 1}
    of_one = None in roles.positions or not roles.positions
    count = len(table.cells)
    column = {k: table.key(k) for k in text}
    hinted = {hint: [k for k in text if roles.labels[k] == hint] for hint in ("pose", "target", "name", "")}
    pose = next((k for k in hinted["pose"] if poses is None or len(set(text[k])) == poses), None)
    if not of_one or not roles.positions:  # targets have columns of their own, or there are none
        for k in [*hinted["pose"], *hinted["name"], *hinted[""]]:
            if len(set(text[k])) == count and all(text[k]):
                yield PointLabels({"pose": column[k]}, text[k])
                return
        yield PointLabels({}, None)
        return
    names = [*hinted["target"], *hinted["name"], *hinted[""], *(k for k in hinted["pose"] if k != pose)]
    for k in names:
        different = len(set(text[k]))
        if pose is not None and k != pose and all(text[k]) and 1 < different <= MOST_TARGETS:
            pairs = len(set(zip(text[pose], text[k], strict=True)))
            if pairs >= 0.98 * count:
                yield PointLabels({"target": column[k], "pose": column[pose]}, text[pose])
    for k in names:
        if not all(text[k]):
            continue
        patterns = _patterns(text[k], poses)
        if patterns is not None:
            regexes = [re.compile(pattern_regex(pattern)) for pattern in patterns]
            matches = [next(match for regex in regexes if (match := regex.fullmatch(name))) for name in text[k]]
            yield PointLabels({"name": [column[k]], "names": patterns}, [match["pose"] for match in matches])
    for k in names:
        counts = Counter(text[k])
        if all(text[k]) and 1 < len(counts) <= MOST_TARGETS and 2 * len(counts) <= count:
            yield PointLabels({"target": column[k]}, None)
    for k in [*hinted["pose"], *names]:
        if len(set(text[k])) == count and all(text[k]):
            yield PointLabels({"pose": column[k], "fixed": "smr1"}, text[k])
    if poses is None or poses == count:
        yield PointLabels({"fixed": "smr1"}, None)


def _patterns(names: Sequence[str], poses: int | None) -> list[str] | None:
    """Patterns that take names of points apart into poses and targets; None where there are none."""
    prefix = ""
    name_pieces = [name.split("::") for name in names]
    if len({len(row) for row in name_pieces}) == 1:
        while len(name_pieces[0]) > 1 and len({row[0] for row in name_pieces}) == 1:
            prefix += "{ignore}::"
            name_pieces = [row[1:] for row in name_pieces]
        if len(name_pieces[0]) == 2:
            halves = [list(column) for column in zip(*name_pieces, strict=True)]
            if _quality(halves[0], halves[1], poses) is not None and len(set(halves[1])) < len(set(halves[0])):
                return [f"{prefix}{{pose}}::{{target}}"]
    tails = ["::".join(row) for row in name_pieces]
    single = _best_pattern(tails, poses)
    if single is not None:
        return [prefix + single]
    by_shape: dict[str, list[str]] = {}
    for name in tails:
        by_shape.setdefault(without_digits(name), []).append(name)
    patterns = [_lettered(of_shape) for of_shape in by_shape.values()]
    if len(patterns) > 10 or any(pattern is None for pattern in patterns):
        return None
    regexes = [re.compile(pattern_regex(str(pattern))) for pattern in patterns]
    matches = [next((match for regex in regexes if (match := regex.fullmatch(name))), None) for name in tails]
    if any(match is None for match in matches):
        return None
    poses_of = [last_number(match["pose"]) for match in matches if match]
    pairs = set(zip(poses_of, [match["target"] for match in matches if match], strict=True))
    if len(pairs) < 0.98 * len(names) or len({target for _, target in pairs}) > MOST_TARGETS:
        return None
    return [prefix + str(pattern) for pattern in dict.fromkeys(patterns)]


def _best_pattern(names: Sequence[str], poses: int | None) -> str | None:
    best: tuple[float, str] | None = None
    for separator, pose_first in itertools.product(_SEPARATORS, (True, False)):
        if not all(separator in name for name in names):
            continue
        halves = [name.rpartition(separator) for name in names]
        left, right = [half[0] for half in halves], [half[2] for half in halves]
        quality = _quality(left, right, poses) if pose_first else _quality(right, left, poses)
        if quality is not None and (best is None or quality > best[0]):
            first, second = ("pose", "target") if pose_first else ("target", "pose")
            best = quality, f"{{{first}}}{separator}{{{second}}}"
    return None if best is None else best[1]


def _quality(poses: Sequence[str], targets: Sequence[str], known: int | None) -> float | None:
    """How completely two parts of names are poses and targets, 1 at best; None where they are not."""
    if not all(poses) or not all(targets):
        return None
    n_poses, n_targets = len(set(poses)), len(set(targets))
    pairs = len(set(zip(poses, targets, strict=True)))
    complete = len(poses) / (n_poses * n_targets)
    if n_targets > min(MOST_TARGETS, n_poses) or pairs < 0.98 * len(poses) or complete < 0.5:
        return None
    if n_targets == 1 and n_poses < len(poses):
        return None
    return complete - (0.2 if known is not None and n_poses > known else 0.0) - (0.3 if n_targets == 1 else 0.0)


def _lettered(names: Sequence[str]) -> str | None:
    """Pattern of names of one shape, such as P12K1: two parts of letters and digits."""
    matches = [re.fullmatch(r"(\D*?)(\d+)([_\-@/ .:]?)(\D*?)(\d+)", name) for name in names]
    if not matches or any(match is None for match in matches):
        return None
    first, second = ({match[group] for match in matches if match} for group in (2, 5))
    start, _, mark, middle, _ = matches[0].groups() if matches[0] else ("", "", "", "", "")
    if not mark and not middle:
        return None
    pose_first = len(first) >= len(second)
    fields = ("pose", "target") if pose_first else ("target", "pose")
    texts = [
        f"{{{name}={letters}}}" if letters else f"{{{name}}}"
        for name, letters in zip(fields, (start, middle), strict=True)
    ]
    return mark.join(texts)


def last_number(name: str) -> int | None:
    """The last number in a name, None without any."""
    numbers = re.findall(r"\d+", name)
    return int(numbers[-1]) if numbers else None
