"""A calibration: what comes out of the main job, can be saved, and comes back from its folder."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from irbcal.calibration_options import CalibrationOptions
from irbcal.calibration_record import recorded
from irbcal.declared_options import takes_fields_of
from irbcal.error_statistics import orientation_line, statistics_table
from irbcal.errors import CalibrationError, OptionError
from irbcal.identification.fit_sections import (
    DIGITS,
    AverageChoice,
    ParameterReport,
    groups_table,
    identified_in_words,
    models_table,
    reached_in_words,
)
from irbcal.io import calibration_folder
from irbcal.io.calibration_folder import FILE_NAMES
from irbcal.io.schema import Record
from irbcal.io.urdf_xml import MeshPaths
from irbcal.measurement.cleaning import left_out
from irbcal.measurement.points import Errors
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.option_values import Progress
from irbcal.overwriting import refuse_replacing
from irbcal.parallel import on_workers
from irbcal.pipeline import Validated, check, clean, fit, read, split, validate, with_commands
from irbcal.public_calls import refusing_wrong_calls
from irbcal.reports.languages import PageLanguage
from irbcal.summary import Paragraph, Result, Table, TableValue, remarks, simulated_mark, values
from irbcal.validation.verdict import Verdict, verdict_of
from irbcal.wording import counted

if TYPE_CHECKING:
    import pandas as pd

    from irbcal.reports.report_charts import Plots
    from irbcal.reports.report_facts import ReportFacts


def parameter_row(row: ParameterReport) -> tuple[TableValue, ...]:
    """A parameter for a table: name, value, standard deviation, unit, state."""
    digits = DIGITS.get(row.unit, 6)
    std = "–" if row.std is None else f"{row.std:.{digits}f}"
    return row.name, f"{row.value:+.{digits}f}", std, row.unit, row.state


def error_table(r: Record, nominal: Errors, calibrated: Errors, proven: bool, targets: bool = True) -> Table:
    """Position errors of a calibration and its nominal robot, all and by target on request."""
    compared, model = r.model != "nominal", f"model {r.model}"
    entries: list[tuple[str, str, Mapping[str, Any]]] = []
    if compared:
        entries.append(("all targets", "nominal", nominal.all.model_dump()))
    headline = len(entries)
    entries.append(("all targets", model, calibrated.all.model_dump()))
    if proven and r.heldout_least_squares:
        entries.append(("all targets", "… by rms", r.heldout_least_squares.all.model_dump()))
    for name in calibrated.per_target if targets and len(calibrated.per_target) > 1 else ():
        if compared:
            entries.append((name, "nominal", nominal.per_target[name].model_dump()))
        entries.append((name, model, calibrated.per_target[name].model_dump()))
    kind = simulated_mark(r.simulated)
    errors = "position errors" if r.features is None else "distances of rows from their features"
    scope = (
        f"{errors} on {r.poses_heldout} poses that the fit never saw"
        if proven
        else f"{errors} on the fitted poses: NOTHING WAS HELD OUT, this is not the robot's accuracy"
    )
    return statistics_table(f"{kind}{scope}, mm", entries, {headline})


def reached(r: Record) -> str:
    """What the method reached, in words."""
    return reached_in_words(r.objective.name, r.objective.value_mm, r.objective.lower_bound_mm, r.method, _held(r))


def held_lines(r: Record, verbose: bool) -> list[str]:
    """What is held, each in a line, or how many in one."""
    if verbose or not r.undetermined:
        return [f"  held: {sentence}" for sentence in r.undetermined]
    held = counted(len(r.undetermined), "combination")
    return [f"  held: {held} of these parameters, which these poses do not show: --verbose lists them"]


def left_out_lines(r: Record, verbose: bool) -> list[str]:
    """How many points were left out, and which ones: the first of each reason, or all."""
    whole = f" ({counted(r.poses_excluded, 'pose')} left out whole)" if r.poses_excluded else ""
    return left_out(r.excluded, None if verbose else 8, whole)


def _held(r: Record) -> str:
    """What a certificate rests on."""
    names = [parameter.name for parameter in r.parameters if parameter.state == "held"]
    return f" and with {', '.join(names)} held" if names else ""


def feature_tables(r: Record, verbose: bool) -> list[Paragraph]:
    """What was held out in turn and how it agreed with itself, known lengths, and where the scale comes from."""
    section = r.features
    if section is None:
        return []
    lines: list[Paragraph] = []
    pair = section.length_error()
    if pair is not None:
        lines.append(
            f"Known lengths at places left out: wrong by {pair[1]:.3f} mm on average ({pair[0]:.3f} mm with the "
            "nominal robot)"
        )
    if section.places:
        rows: tuple[tuple[TableValue, ...], ...] = tuple(
            (row.name, row.rows, row.nominal_mean_mm, row.mean_mm, row.rms_mm, row.max_mm) for row in section.places
        )
        columns = (section.left_out or "", "rows", "nominal mean", "mean", "rms", "max")
        lines.append(Table(f"Each {_one(section.left_out)} left out of the fit in turn, mm", columns, rows))
    if verbose:
        fitted = tuple((row.name, row.kind, row.rows, row.nominal_rms_mm, row.rms_mm) for row in section.features)
        lines.append(
            Table("Features in the fit, rms in mm", ("feature", "kind", "rows", "nominal", "calibrated"), fitted)
        )
    return lines


def model_tables(r: Record) -> list[Paragraph]:
    """Why this model, and the error models that were compared."""
    lines: list[Paragraph] = [r.choice.explanation] if r.choice else []
    if isinstance(r.choice, AverageChoice):
        lines.append(models_table(r.choice.table))
    return lines


def _one(by: str | None) -> str:
    return "set of features" if by == "features" else str(by)


FORMATS: tuple[Literal["png", "svg"], ...] = ("png", "svg")  # of a report's figures as files


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Result):
    """A calibrated robot with its proof: just identified, or loaded from its folder.

    Attributes
    ----------
    record : Record
        Content of ``calibration.json``.
    urdf : bytes
        The corrected URDF.
    folder : Path or None
        Where it was loaded from.
    validated : Validated or None
        Of one just identified: the fits with their problems, points and measurements. None of a loaded one.
    """

    record: Record
    urdf: bytes
    folder: Path | None = None
    validated: Validated | None = None

    def robot_calibrated(self) -> Robot:
        """The calibrated robot: predicts points and poses from commanded joints."""
        return self.record.robot_calibrated()

    def robot_nominal(self) -> Robot:
        """The nominal robot with base and tool identified from the same poses."""
        return self.record.robot_nominal()

    def arm(self, calibrated: bool = True) -> Arm:
        """The calibrated (or nominal) arm."""
        return self.record.arm(calibrated)

    @refusing_wrong_calls
    def save(
        self,
        folder: str | Path,
        *,
        world_link: bool = False,
        target_links: bool = False,
        mesh_paths: MeshPaths = "package",
        overwrite: bool = False,
    ) -> Record:
        """See `irbcal.save`."""
        return save(
            self,
            folder,
            world_link=world_link,
            target_links=target_links,
            mesh_paths=mesh_paths,
            overwrite=overwrite,
        )

    @property
    def plot(self) -> Plots:
        """The report's figures: ``calibration.plot.errors_by_pose()`` and others."""
        from irbcal.reports.report_charts import Plots

        return Plots(self.record)

    def to_frame(self, what: Literal["parameters", "points"] = "parameters") -> pd.DataFrame:
        """The parameters, or the used points with their errors, as a table.

        Parameters
        ----------
        what : {"parameters", "points"}
            Parameters: name, value, unit, std, low, high, state, reason. Points: pose, group, target, heldout,
            nominal_mm, calibrated_mm, and the measured places where they were saved.
        """
        import pandas as pd

        from irbcal.option_values import checked

        checked("what", what, ("parameters", "points"))
        if what == "parameters":
            return pd.DataFrame([vars(parameter) for parameter in self.record.parameters])
        columns = {name: values for name, values in self.record.points if values}
        return pd.DataFrame(columns)

    def headline(self) -> str:
        """What it is worth, in one line."""
        r = self.record
        kind = "SIMULATED, " if r.simulated else ""
        at = " distance from features" if r.features else ""
        if r.heldout is None or r.heldout_nominal is None:
            return f"{r.robot.name}, {kind}model {r.model}: nothing was held out, so its accuracy is unknown"
        return (
            f"{r.robot.name}, {kind}model {r.model}: held-out mean{at} {r.heldout_nominal.all.mean_mm:.3f} -> "
            f"{r.heldout.all.mean_mm:.3f} mm (largest {r.heldout.all.max_mm:.3f} mm) on {r.poses_heldout} poses"
        )

    def report(self) -> Sequence[Paragraph]:
        """What ``irbcal calibrate`` prints: the verdict, errors, and what limits them most; see `proof` for all."""
        from irbcal.reports.report_facts import limits

        r = self.record
        lines = [*self.verdict.report(), self._errors(targets=False), self._identified()]
        lines += [f"What limits it: {limit.sentence} {limit.next}" for limit in limits(r, self.report_facts)[:1]]
        more = [
            f"{count} {unit}{'s'[: count != 1]}{rest}"
            for count, unit, rest in ((len(r.notes_to_read()), "note", ""), (len(r.excluded), "point", " left out"))
            if count
        ]
        return lines + (
            [f"Not shown: {' and '.join(more)} (report.html, --verbose, in Python proof())"] if more else []
        )

    @cached_property
    def report_facts(self) -> ReportFacts:
        """Errors of its points and what explains them, as the report shows them."""
        from irbcal.reports import report_facts

        return report_facts.gather(self.record, None if self.validated is None else self.validated.coverage)

    @cached_property
    def verdict(self) -> Verdict:
        """Better than the nominal robot, no better or worse, and whether that may be trusted."""
        return verdict_of(self.record)

    def proof(self, verbose: bool = True) -> list[Paragraph]:
        """The verdict, errors before and after, what was identified, what was held or left out, and what to doubt."""
        r = self.record
        nominal, calibrated = (r.heldout_nominal, r.heldout) if r.heldout is not None else (r.fit_nominal, r.fit)
        assert nominal is not None
        lines = [*self.verdict.report(), self._errors(), *feature_tables(r, verbose)]
        if calibrated.orientation and nominal.orientation:
            models = (("nominal", nominal.orientation), (f"model {r.model}", calibrated.orientation))
            lines += [orientation_line(name, turned.model_dump()) for name, turned in models]
        groups = () if r.evidence is None else r.evidence.groups
        lines += [self._identified(), *([groups_table(groups)] if groups else []), *model_tables(r)]
        lines += [*held_lines(r, verbose), *left_out_lines(r, verbose)]
        lines += remarks("Note", r.notes_to_read())
        check = r.urdf_witnesses
        lines.append(
            f"The written URDF as {check.in_words()} read it: differs by {check.position_m:.1e} m, "
            f"{check.rotation_rad:.1e} rad"
        )
        lines.append(f"Link frames moved by at most {r.largest_link_shift_mm:.3f} mm at zero joints")
        return lines

    def _errors(self, targets: bool = True) -> Table:
        """Errors before and after, of all targets and on request of each; of held-out poses where there are any."""
        r = self.record
        nominal, calibrated = (r.heldout_nominal, r.heldout) if r.heldout is not None else (r.fit_nominal, r.fit)
        assert nominal is not None
        assert calibrated is not None
        return error_table(r, nominal, calibrated, r.heldout is not None, targets)

    def _identified(self) -> str:
        r = self.record
        return (
            f"{r.robot.name}, model {r.model}: {identified_in_words(r.rank, r.parameter_count, r.poses_fit)} "
            f"({reached(r)})"
        )

    def parameter_table(self) -> Table:
        """Parameters with their standard deviation, unit and state."""
        rows: list[tuple[TableValue, ...]] = [parameter_row(parameter) for parameter in self.record.parameters]
        return Table("Parameters", ("name", "value", "±", "unit", "state"), tuple(rows))

    CONTENT = (
        "robot=record.robot.name model=record.model method=record.method simulated=record.simulated "
        "objective=record.objective fit=record.fit.all heldout=record.heldout.all "
        "nominal_heldout=record.heldout_nominal.all per_target=record.heldout.per_target rank=record.rank "
        "parameters=record.parameter_count undetermined=record.undetermined choice=record.choice "
        "excluded=record.excluded notes=record.notes largest_link_shift_mm=record.largest_link_shift_mm "
        "urdf_witnesses=record.urdf_witnesses seconds=record.seconds verdict"
    )

    def to_dict(self, out: str | Path | None = None) -> dict[str, Any]:
        """What ``irbcal calibrate --json`` prints: the folder ``out``, ``CONTENT``, and how many ``poses`` it used."""
        poses = values(self.record, "fit=poses_fit heldout=poses_heldout excluded=poses_excluded")
        return {"out": None if out is None else str(out), **super().to_dict(), "poses": poses}


@on_workers
@takes_fields_of(CalibrationOptions)
def calibrate(options: CalibrationOptions) -> Calibration:
    """Identify a robot from measurements and validate it on held-out poses.

    Raises
    ------
    IrbcalError
        If an input or an option is refused.
    """
    record, urdf, validated = run(options)
    return Calibration(record, urdf, None, validated)


def run(options: CalibrationOptions) -> tuple[Record, bytes, Validated]:
    """All steps from measurements to the record, and the corrected URDF."""
    started = time.perf_counter()
    say: Progress = options.progress or (lambda text: None)
    options = replace(options, progress=None)
    if options.features is not None:
        from irbcal.feature_pipeline import fit_rows, read_rows, validate_rows

        validated = validate_rows(fit_rows(read_rows(options, say), say), say)
    else:
        validated = validate(check(fit(split(clean(with_commands(read(options, say), say))), say)))
    return *recorded(validated, started), validated


def load(folder: str | Path) -> Calibration:
    """Read a calibration folder.

    Parameters
    ----------
    folder : str or Path
        Of an earlier calibration.

    Raises
    ------
    CalibrationError
        If a file is missing, damaged, or the URDF is not the one the calibration was written with.
    """
    saved = calibration_folder.read(folder)
    return Calibration(saved.record, saved.urdf, saved.folder)


def save(
    calibration: Calibration,
    folder: str | Path,
    *,
    world_link: bool = False,
    target_links: bool = False,
    mesh_paths: MeshPaths = "package",
    overwrite: bool = False,
) -> Record:
    """Write a calibration folder: all its files, or none.

    Parameters
    ----------
    calibration : Calibration
    folder : str or Path
        Made if absent; other files in it are left alone.
    world_link : bool
        Add the measuring frame to the URDF.
    target_links : bool
        Add the reflectors to the URDF.
    mesh_paths : {"package", "relative", "absolute"}
        How mesh files stand in the URDF: as they were, or as paths (from the folder, or whole) that readers without
        package folders open, such as MuJoCo, urchin and yourdfpy.
    overwrite : bool
        Replace a calibration that is in the folder already.

    Raises
    ------
    CalibrationError
        If there is a calibration in the folder already, it cannot be written, or Pinocchio or yourdfpy disagrees with
        the URDF.
    RobotError
        If a mesh file whose path is asked for is not found.
    """
    from irbcal.io import robots, urdf
    from irbcal.io import urdf_xml as paths
    from irbcal.option_values import checked
    from irbcal.reports import report_page
    from irbcal.safe_files import made_folders

    how = checked("mesh_paths", mesh_paths, paths.CHOICES)
    refuse_replacing(Path(folder), overwrite)
    with made_folders(folder, names=FILE_NAMES):
        record, other_sessions = (
            calibration.record,
            tuple(f"@{session.name}" for session in calibration.record.sessions[:-1]),
        )
        T_world_base, targets, _ = record.placement.base_and_targets()
        targets = {name: xyz for name, xyz in targets.items() if target_links and not name.endswith(other_sessions)}
        data = urdf.with_links(calibration.urdf, calibration.arm(), T_world_base if world_link else None, targets)
        nominal = calibration.folder if calibration.validated is None else calibration.validated.robot_file.parent
        meshes = paths.MeshFolders(nominal, robots.package_dirs(*(record.mesh_folders or ())))
        data = paths.with_mesh_paths(data, how, folder, meshes, record.robot.urdf)
        record = record.with_urdf(data)
        calibration_folder.write(folder, record, data, report_page.render(record, calibration.report_facts))
    return record


def report(
    calibration: str | Path | Calibration,
    *,
    figures: str | Path | None = None,
    format: Literal["png", "svg"] | None = None,
    data: str | Path | None = None,
    language: PageLanguage = "en",
    progress: Progress | None = None,
) -> dict[Path, tuple[str, ...]]:
    """Write ``report.html`` of a calibration folder again, with its figures and data as files on request.

    Parameters
    ----------
    calibration : str, Path or Calibration
        Its folder, or one loaded from its folder.
    figures : str or Path, optional
        Folder for the figures.
    data : str or Path, optional
        Folder for the data behind figures and tables (CSV).
    format : {"png", "svg"}, optional
        Of the figures; ``png`` unless given.
    language : {"en", "de", "fr", "ja", "zh"}
        Of the page; figures and data stay English.
    progress : callable, optional
        Called with a short text at each step.

    Returns
    -------
    dict of Path to tuple of str
        Folder -> names of the files written there.

    Raises
    ------
    IrbcalError
        If the folder is no calibration or cannot be written, the calibration was not saved yet, or a format is given
        without a folder for figures.
    """
    from irbcal.option_values import checked
    from irbcal.reports import report_facts, report_page
    from irbcal.reports.languages import LANGUAGES
    from irbcal.reports.translated_pages import translated
    from irbcal.safe_files import made_folders, write_set

    kind: Literal["png", "svg"] = checked("format", format or "png", FORMATS)
    checked("language", language, LANGUAGES)
    if format is not None and figures is None:
        raise OptionError("format: only figures have one: name their folder", parameter="format")
    say = progress or (lambda text: None)
    say("reading the calibration")
    record, out = _report_of(calibration)
    folders: dict[Path, dict[str, bytes]] = {Path(folder): {} for folder in (out, figures, data) if folder is not None}
    with made_folders(*folders):
        say("computing errors")
        facts = report_facts.gather(record)
        say("drawing")
        if figures is not None:
            folders[Path(figures)] |= report_page.figure_files(record, facts, kind)
        if data is not None:
            folders[Path(data)] |= report_page.data_files(record, facts)
        page = translated(report_page.render(record, facts, report_page.view_beside(out)), language)
        folders[out] |= calibration_folder.with_page(out, page.encode("utf-8"))
        write_set({folder / name: content for folder, files in folders.items() for name, content in files.items()})
    return {folder: tuple(files) for folder, files in folders.items()}


def _report_of(calibration: str | Path | Calibration) -> tuple[Record, Path]:
    """The calibration as it stands in its folder, and the folder."""
    folder = getattr(calibration, "folder", None) if not isinstance(calibration, (str, Path)) else calibration
    if folder is None:
        raise CalibrationError(
            "expected a calibration folder or a calibration loaded from one: save it first", parameter="calibration"
        )
    saved = calibration_folder.read(folder)
    return saved.record, saved.folder
