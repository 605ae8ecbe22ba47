"""``irbcal import``: files as other programs write them in, a measurement file out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json

if TYPE_CHECKING:
    from irbcal.measurement.imports.imported import Imported

SHOWN = 10
"""Rows in the JSON document of a dry run."""


def _show_preset(name: str | None) -> None:
    if name is not None:
        from irbcal.measurement.imports import feature_rows, map_file

        print(feature_rows.TEXT if name == feature_rows.NAME else map_file.preset_text(name), end="")
        raise typer.Exit


def import_files(
    sources: Annotated[list[Path], typer.Argument(metavar="SOURCE", help="Files of one kind.", show_default=False)],
    as_: Annotated[
        str, typer.Option("--as", metavar="PRESET|MAP.yaml", help="Which columns mean what.", show_default=False)
    ],
    out: Annotated[
        Path | None, typer.Option(help="Measurement file to write (CSV).", metavar="FILE", show_default=False)
    ] = None,
    joints: Annotated[
        Path | None,
        typer.Option(
            help="Joints where the sources hold points only: a program, or q1_deg …, optional pose, group, target.",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change the map, such as units.lengths=mm; may be repeated."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show the first rows as they would be understood; write nothing.")
    ] = False,
    show_preset: Annotated[
        str | None,
        typer.Option(
            "--show-preset",
            metavar="NAME",
            callback=_show_preset,
            is_eager=True,
            help="Print a preset, to copy and change it, and stop.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Turn files of other programs into a measurement file.

    A preset or a map of your own (YAML) says which columns mean what. Units are declared, never guessed.

    Presets, with an example each:

    robodk: J1-6, X Y Z [, rx ry rz] [, TCP] --
    irbcal import robodk.csv --as robodk --out measured.csv

    spatial-analyzer: names, x y z, // comments --
    irbcal import points.txt --as spatial-analyzer --set units.lengths=mm --joints joints.csv --out measured.csv

    leica-tmac: X Y Z Q0 Q1 Q2 Q3 --
    irbcal import tmac.csv --as leica-tmac --joints joints.csv --out measured.csv

    per-target: one log for each target --
    irbcal import smr*.csv ref*.csv --as per-target --set units.lengths=mm --joints joints.csv --out measured.csv

    ur10-lab: semicolons, decimal commas, radians --
    irbcal import export.csv --as ur10-lab --out measured.csv

    table: any table with a header (a refused file says its line) --
    irbcal import wide.csv --as table --set 'columns.joints=[J1, J2, J3, J4, J5, J6]' --set units.joints=deg
    --set 'columns.position={smr1: [X1, Y1, Z1], smr2: [X2, Y2, Z2]}' --set units.lengths=mm --out measured.csv

    features: rows at balls, planes, strings ..., as calibrate --features takes them --
    irbcal import strings.csv --as features --set 'columns.joints=[J1, J2, J3, J4, J5, J6]' --set units.joints=deg
    --set 'columns.values={string 1: L1, string 2: L2}' --set units.lengths=mm --out rows.csv

    irbcal: its own format, to be read otherwise --
    irbcal import measured.csv --as irbcal --set 'joints.signs=[1, 1, -1, 1, 1, 1]' --out mended.csv

    Try any of them with --dry-run first.
    """
    from irbcal.measurement.imports.feature_rows import is_of_features

    if out is None and not dry_run:
        raise typer.BadParameter("expected a file to write to, or --dry-run", param_hint="--out")
    understand = _features if is_of_features(as_) else _points
    understand(sources, as_, out, joints, set_ or (), dry_run, json)
    if dry_run and not json:
        show.say("Nothing was written: this was a dry run")


def _points(
    sources: list[Path], as_: str, out: Path | None, joints: Path | None, set_: Sequence[str], dry_run: bool, json: bool
) -> None:
    """Understand points, write, tell."""
    from irbcal.errors import OptionError
    from irbcal.measurement.imports.reader import import_measurements

    try:
        imported = import_measurements(*sources, as_=as_, out=out, joints=joints, set_=set_, dry_run=dry_run)
    except OptionError as error:
        raise typer.BadParameter(str(error), param_hint=f"--{error.parameter}") from None
    if json:
        show.print_json(_summary(imported, dry_run))
    else:
        show.tell(imported.told())


def _features(
    sources: list[Path], as_: str, out: Path | None, joints: Path | None, set_: Sequence[str], dry_run: bool, json: bool
) -> None:
    """Understand rows at features, write, tell."""
    from irbcal.measurement.imports.feature_rows import import_features

    if joints is not None:
        raise typer.BadParameter("rows at features have their joints beside them", param_hint="--joints")
    imported = import_features(*sources, as_=as_, out=out, set_=set_, dry_run=dry_run)
    if json:
        show.print_json(imported.to_dict())
    else:
        show.tell(imported.told())


def _summary(imported: Imported, dry_run: bool) -> dict[str, Any]:
    summary: dict[str, Any] = {
        "out": str(imported.out) if imported.out else None,
        "rows": len(imported.table),
        "poses": imported.poses,
        "targets": {name: {"measured": m, "lost": k} for name, (m, k) in imported.targets.items()},
        "lost": int(imported.lost.sum()),
        "groups": imported.groups,
        "warnings": list(imported.warnings),
        "map": imported.map.model_dump(exclude_defaults=True),
    }
    if dry_run:
        summary["first_rows"] = imported.first_rows(SHOWN)
    return summary
