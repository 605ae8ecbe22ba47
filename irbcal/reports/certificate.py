"""A certificate: what a calibrated robot reached on measurements of its own, on a page to print and to sign.

It says what an evaluation found and where that comes from; it runs no script and loads nothing.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Literal

from irbcal import __version__
from irbcal.error_statistics import headed
from irbcal.errors import OptionError
from irbcal.option_values import checked
from irbcal.plotting import charts
from irbcal.plotting.charts import Chart
from irbcal.plotting.pose_errors import WorstPose, errors_by_pose, vectors, workspace, worst_poses
from irbcal.plotting.pose_sets import PoseErrors
from irbcal.reports import report_page
from irbcal.reports.languages import LANGUAGES, PageLanguage
from irbcal.reports.report_page import as_csv
from irbcal.reports.translated_pages import translated
from irbcal.units import MM
from irbcal.validation.evaluation import Evaluation
from irbcal.validation.judged_points import MODELS
from irbcal.validation.provenance import FIELDS, Origin

FORMATS = ("png", "svg")
WORST, NOTES = (8, 8, 5), (7, 7, 4)
"""Poses and notes that are listed, of pages with little, some and much to say."""
NOTE_LINES, FEWEST_WORST = (12, 17), 3
"""Lines of notes that leave room for all worst poses, and most of them; worst poses that are listed beside the most."""
LONGEST = 400
"""Characters of a note."""
LINE, ROOM = 92, (4, 14)
"""Characters of a line; lines of remarks and of what was told beyond which there is no room for the errors by pose,
and none for all the rest on one page."""


def certificate(
    evaluation: Evaluation,
    report: str | Path,
    *,
    figures: str | Path | None = None,
    format: Literal["png", "svg"] | None = None,
    data: str | Path | None = None,
    language: PageLanguage = "en",
) -> dict[Path, tuple[str, ...]]:
    """Write an evaluation as a certificate: one page of HTML to print (A4) and to sign.

    Parameters
    ----------
    evaluation : Evaluation
        Of ``irbcal.evaluate(…, tolerance=…, info=…)``; without a tolerance the page says neither pass nor fail.
    report : str or Path
        Certificate to print (A4) and to sign, a name that ends in ``.html``.
    figures : str or Path, optional
        Folder for the certificate's figures.
    data : str or Path, optional
        Folder for the data behind page and figures (CSV, JSON).
    format : {"png", "svg"}, optional
        Of the figures; ``png`` unless given.
    language : {"en", "de", "fr", "ja", "zh"}
        Of the page; figures and data stay English.

    Returns
    -------
    dict of Path to tuple of str
        Folder -> names of the files written there.

    Raises
    ------
    IrbcalError
        If an option is refused, or a file cannot be written: then none is.
    """
    from irbcal.safe_files import made_folders, write_set

    refuse_wrong_options(report, figures=figures, format=format, language=language)
    path = Path(report)
    kind: Literal["png", "svg"] = format or "png"
    folders: dict[Path, dict[str, bytes]] = {}
    with made_folders(*(Path(folder) for folder in (path.parent, figures, data) if folder is not None)):
        folders.setdefault(path.parent, {})[path.name] = translated(render(evaluation), language).encode("utf-8")
        if figures is not None:
            drawn = {f"{f.name}.{kind}": f.marked(evaluation.simulated).content(kind) for f in draw(evaluation)}
            folders.setdefault(Path(figures), {}).update(drawn)
        if data is not None:
            folders.setdefault(Path(data), {}).update(data_files(evaluation))
        write_set({folder / name: content for folder, files in folders.items() for name, content in files.items()})
    return {folder: tuple(files) for folder, files in folders.items()}


def refuse_wrong_options(
    report: str | Path,
    *,
    figures: str | Path | None = None,
    format: str | None = None,
    language: str = "en",
    **_other: object,
) -> None:
    """Refuse wrong options of a `certificate`: before the evaluation, which may take minutes.

    Raises
    ------
    OptionError
    """
    checked("format", format or "png", FORMATS)
    if format is not None and figures is None:
        raise OptionError("format: only figures have one: name their folder", parameter="format")
    checked("language", language, LANGUAGES)
    path = Path(report)
    if path.suffix.lower() not in (".html", ".htm"):
        raise OptionError(f"report: expected a name that ends in .html, found {path.name!r}", parameter="report")


def render(evaluation: Evaluation, issued: datetime | None = None) -> str:
    """The certificate as one HTML page.

    Parameters
    ----------
    evaluation : Evaluation
    issued : datetime, optional
        Now unless given.

    Raises
    ------
    OptionError
        If the evaluation does not know where it comes from.
    """
    origin, conformity = _origin(evaluation), evaluation.conformity
    remarks, stated = _remarks(evaluation), origin.stated()
    crowded = sum(_lines([text for _, text in remarks], stated) > room for room in ROOM)
    notes = _notes(evaluation, NOTES[crowded])
    worst = max(FEWEST_WORST, min(WORST[crowded], WORST[crowded] + NOTE_LINES[0] - _text_lines(notes)))
    return report_page.template("certificate.html.j2").render(
        e=evaluation,
        origin=origin,
        kept=conformity,
        key_mark=charts.key,
        stated=stated,
        remarks=remarks,
        crowded=crowded,
        statistics=headed("mean", "sigma", "mean_plus_3sigma", "p95", "max"),
        rows=_rows(evaluation),
        intervals=_intervals(evaluation),
        worst=_worst(evaluation, worst),
        figures=draw(evaluation)[:2],
        notes=notes,
        issued=(issued or datetime.now(timezone.utc)).strftime("%Y-%m-%d %H:%M UTC"),
        version=__version__,
    )


def draw(evaluation: Evaluation) -> list[Chart]:
    """Errors of the calibrated robot by pose, with the tolerance, and over the workspace; error vectors of both."""
    conformity = evaluation.conformity
    calibrated = _calibrated(evaluation)
    tolerance_mm = None if conformity is None else conformity.tolerance_mm
    return [
        errors_by_pose(calibrated, tolerance_mm),
        workspace(calibrated, tolerance_mm),
        vectors(evaluation.errors),
    ]


def data_files(evaluation: Evaluation) -> dict[str, bytes]:
    """What the certificate rests on: points and poses as CSV, everything else as JSON.

    Lengths in mm, angles in degrees; vectors along the axes of the base link.
    """
    e, origin = evaluation.errors, _origin(evaluation)
    poses = [
        {
            "pose": name,
            "group": e.groups[k],
            **{
                f"q{j}_{unit}": round(float(value), 9)
                for j, (unit, value) in enumerate(zip(origin.joint_units, origin.joints[k], strict=True), 1)
            },
            **{f"{label}_mm": round(float(m.per_pose[k] / MM), 6) for label, m in e.models.items()},
        }
        for k, name in enumerate(e.pose_names)
    ]
    points = evaluation.to_frame().round({f"calibrated_d{axis}_mm": 6 for axis in "xyz"}).to_dict("records")
    rows = [{str(key): value for key, value in row.items()} for row in points]
    data = json.dumps({"irbcal": __version__, **evaluation.to_dict()}, indent=1, allow_nan=False, ensure_ascii=False)
    return {
        "points.csv": as_csv(rows, evaluation.simulated),
        "poses.csv": as_csv(poses, evaluation.simulated),
        "certificate.json": f"{data}\n".encode(),
    }


def _origin(evaluation: Evaluation) -> Origin:
    if evaluation.origin is None:
        raise OptionError("expected an evaluation of irbcal.evaluate, which knows its files", parameter="evaluation")
    return evaluation.origin


def _calibrated(evaluation: Evaluation) -> PoseErrors:
    """Errors of the calibrated robot alone."""
    return replace(evaluation.errors, models={"calibrated": evaluation.errors.models["calibrated"]})


def _worst(evaluation: Evaluation, count: int) -> list[WorstPose]:
    return worst_poses(evaluation.errors, _origin(evaluation).joints, count)


def _rows(evaluation: Evaluation) -> list[tuple[str, dict[str, Any]]]:
    return [(name, {**getattr(evaluation, name), **evaluation.percentiles[name]}) for name in MODELS]


def _intervals(evaluation: Evaluation) -> dict[str, Any]:
    """Intervals of the calibrated robot's statistics, empty where there are none."""
    if evaluation.conformity is not None:
        return dict(evaluation.conformity.intervals_mm)
    return dict((evaluation.intervals or {}).get("calibrated") or {})


def _lines(remarks: Sequence[str], stated: Sequence[tuple[str, str]]) -> int:
    """Lines that remarks, and what was told beyond `FIELDS`, take of the first page."""
    pairs = [stated[k : k + 2] for k in range(0, len(stated), 2)]
    long = sum(any(len(value) > LINE // 3 for _, value in pair) for pair in pairs)
    return _text_lines(remarks) + long + len(pairs) - (len(FIELDS) + 1) // 2


def _text_lines(texts: Sequence[str]) -> int:
    """Lines of the page that texts take, each begun again."""
    return sum(-(-len(text) // LINE) for text in texts)


def _short(notes: Sequence[str], limit: int) -> list[str]:
    """So many notes at most, none too long."""
    short = [text if len(text) <= LONGEST else f"{text[:LONGEST]} …" for text in notes]
    more = len(short) - limit
    return [*short[:limit], f"{more} more: irbcal evaluate prints them."] if more > 0 else short


def _remarks(evaluation: Evaluation) -> list[tuple[str, str]]:
    """What stands beside the verdict, in sentences; those against a pass are called so."""
    conformity = evaluation.conformity
    if conformity is None:
        return [("against", text) for text in _short(evaluation.verdict.doubts, 4)]
    label = "Also: " if conformity.outcome == "fail" else "No pass: "
    return [("against", label + text) for text in _short(conformity.against, 4)]


def _notes(evaluation: Evaluation, limit: int) -> list[str]:
    """What a reader must know besides the verdict."""
    reasons = [f"{n} × {kind}" for kind, n in Counter(point.kind for point in evaluation.excluded).items()]
    notes = [
        *_origin(evaluation).scope,
        *([f"Measured points left out: {', '.join(reasons)}."] if reasons else []),
        *evaluation.notes,
    ]
    while limit > 1 and _text_lines(_short(notes, limit)) > NOTE_LINES[1]:
        limit -= 1
    return _short(notes, limit)
