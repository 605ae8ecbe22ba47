"""Measurements of other programs and of cameras: ``irbcal import``, ``corners``, ``lens``, ``hand-eye``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.signature import Command, Json, OutFile, Typed, public

if TYPE_CHECKING:
    pass


DRY_RUN_ROWS = 10
"""Rows in the JSON document of a dry run."""


def _show_preset(name: str | None) -> None:
    if name is not None:
        from irbcal.measurement.imports import column_map, feature_rows

        print(feature_rows.PRESET if name == feature_rows.NAME else column_map.preset_text(name), end="")
        raise typer.Exit


@Command(
    "import_measurements",
    arguments=("sources",),
    typed={"as_": Typed(str, "PRESET|MAP.yaml"), "set_": Typed(list[str], "KEY=VALUE")},
    panels={"Everyday": ("robot", "joints", "out", "dry_run", "json")},
)
def import_files(
    options: dict[str, Any],
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

    Tables as text, workbooks and zip archives are understood without a map: columns by their names in several
    languages and by a trial fit of the robot, which also proves units that no file declares. What was understood is
    shown, and its map is written beside the measurement file.

    irbcal import points.txt joints.csv --robot irb120 --out measured.csv

    A preset, or a map of your own (YAML), says it in place of that: --as.

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

    dry_run = options.get("dry_run", False)
    if "out" not in options and not dry_run:
        raise typer.BadParameter("expected a file to write to, or --dry-run", param_hint="--out")
    sources = options.pop("sources")
    if is_of_features(options.get("as_")):
        if "joints" in options:
            raise typer.BadParameter("rows at features have their joints beside them", param_hint="--joints")
        show.result(public("import_features")(*sources, **options), json)
    else:
        show.result(public("import_measurements")(*sources, **options), json)
    if dry_run and not json:
        show.say("Nothing was written: this was a dry run")


@Command("corners", arguments=("images",))
def corners(options: dict[str, Any], out: OutFile, json: Json = False) -> None:
    """Find the corners of boards in pictures: rows for calibrate --features.

    Needs OpenCV: pip install 'irbcal[camera]'.
    """
    result = public("corners")(**options)
    result.save(out)
    show.written(result, out, json)


@Command("lens", arguments=("images",))
def lens(options: dict[str, Any], json: Json = False) -> None:
    """Calibrate the lenses of cameras from pictures of boards alone, proven on pictures that were left out.

    Needs OpenCV: pip install 'irbcal[camera]'.
    """
    show.written(public("lens")(**options), options.get("out"), json)


@Command(
    "hand_eye",
    arguments=("measurements",),
)
def hand_eye(options: dict[str, Any], json: Json = False) -> None:
    """Where cameras and boards are on the flange and in the cell, the robot taken as it is.

    With --images needs OpenCV: pip install 'irbcal[camera]'.
    """
    show.written(public("hand_eye")(**options), options.get("out"), json)
