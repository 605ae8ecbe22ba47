"""``irbcal import``: files as other programs write them in, a measurement file out."""

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show

SHOWN = 10
LONGEST_CELL = 24


def _show_preset(name: str | None):
    if name is not None:
        from irbcal.measurement.imports import column_map

        print(column_map.preset_text(name), end="")
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
            help="Joints of the poses where the sources hold points only: q1_deg … and, optional, pose and group.",
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
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
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

    Try any of them with --dry-run first.
    """
    from irbcal.files.atomic import write_together
    from irbcal.measurement.imports import column_map, reader

    if out is None and not dry_run:
        raise typer.BadParameter("expected a file to write to, or --dry-run", param_hint="--out")
    if out is not None and any(_same(out, path) for path in [*sources, *([joints] if joints else [])]):
        raise typer.BadParameter(f"{out} is one of the files to read", param_hint="--out")
    import_map = column_map.read_map(as_, set_ or ())
    found = reader.understand(sources, import_map, joints)
    data = found.csv()
    if not dry_run:
        _refuse_folder(out)
        write_together(out.parent, {out.name: data})
    if json:
        show.print_json(_summary(found, None if dry_run else out, dry_run))
    else:
        _print(found, None if dry_run else out, dry_run)


def _same(one, other):
    return one.resolve() == other.resolve()


def _refuse_folder(out):
    from irbcal.errors import MeasurementError

    if out.is_dir():
        raise MeasurementError(f"{out}: expected a file to write, found a folder")


def _first_rows(found, count):
    """The first rows as understood, and where each comes from."""
    rows = found.table.head(count)
    values = rows.astype(object).where(rows.notna(), None).to_dict(orient="records")
    return values, found.origin.head(count).to_dict(orient="records")


def _summary(found, out, dry_run):
    groups = {}
    if "group" in found.table.columns:
        counts = found.table.groupby("group")["pose"].nunique()
        groups = {str(name): int(count) for name, count in counts.items()}
    summary = {
        "out": str(out) if out else None,
        "rows": len(found.table),
        "poses": found.poses,
        "targets": {name: {"measured": m, "lost": k} for name, (m, k) in found.targets.items()},
        "lost": int(found.lost.sum()),
        "groups": groups,
        "warnings": found.warnings,
        "map": found.map.model_dump(exclude_defaults=True),
    }
    if dry_run:
        rows, origin = _first_rows(found, SHOWN)
        summary["first_rows"] = [place | values for place, values in zip(origin, rows, strict=True)]
    return summary


def _print(found, out, dry_run):
    if dry_run:
        import yaml

        _table(found)
        show.say("The map in use:")
        text = yaml.safe_dump(
            found.map.model_dump(exclude_defaults=True, exclude={"about"}), sort_keys=False, default_flow_style=None
        )
        show.say(text.rstrip())
    targets = ", ".join(
        f"{name} {seen}" + (f" (and {lost} lost)" if lost else "") for name, (seen, lost) in found.targets.items()
    )
    show.say(f"{len(found.table)} rows, {found.poses} poses, {int(found.lost.sum())} lost points; points: {targets}")
    for text in found.warnings:
        show.note(text + ".")
    show.say(f"Written to {out}" if out else "Nothing was written: this was a dry run")


def _table(found):
    """The first rows, a column each, as a row has too many values for a page."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(markup=False)
    rows, origin = _first_rows(found, max(2, min(SHOWN, (console.width - 16) // 13)))
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("row of file")
    for place in origin:
        table.add_column(str(place["row"]), justify="right", no_wrap=True)
    for name in found.table.columns:
        table.add_row(Text(name), *(Text(_cell(values[name])) for values in rows))
    show.say(f"The first rows of {origin[0]['source']} as they would be understood:")
    console.print(table)


def _cell(value):
    if value is None:
        return ""
    text = f"{value:.4f}" if isinstance(value, float) else str(value)
    return text if len(text) <= LONGEST_CELL else text[: LONGEST_CELL - 1] + "…"
