"""Adding calibration folders to a store: what it keeps of each, with the estimates that are compared later."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from irbcal import parallel
from irbcal.errors import CalibrationError, IdentificationError, IrbcalError, OptionError
from irbcal.fleet import STORE, batch
from irbcal.fleet.comparison import high_wave
from irbcal.fleet.store import Estimate, Stored, opened
from irbcal.identification.evidence import type_terms
from irbcal.identification.fit import certainty_of, identify
from irbcal.identification.type_prior import WIDE, name_of
from irbcal.io import calibration_folder
from irbcal.io.calibration_folder import JSON_NAME
from irbcal.io.opening import open_calibration
from irbcal.io.schema import Record
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.parameters import default_level
from irbcal.option_values import Progress
from irbcal.safe_files import read_bytes
from irbcal.sessions import earlier_of
from irbcal.summary import Paragraph, Result
from irbcal.units import UNIT_OUTSIDE
from irbcal.validation.verdict import verdict_of
from irbcal.wording import counted


def stored(
    folder: str | Path, robot: str | None = None, serial: str | None = None, measured: str | None = None
) -> Stored:
    """A calibration folder as the store takes it.

    Parameters
    ----------
    folder : str or Path
    robot, serial : str, optional
        Id and serial number; those that `irbcal.fleet.batch.fleet_calibrate` wrote beside it, or the folder's
        name, unless given.
    measured : str, optional
        Date, ISO 8601; that of the calibration where none is known.

    Raises
    ------
    CalibrationError
        If the folder is no calibration, or the date is none.
    """
    path = calibration_folder.folder_of(folder)
    record = open_calibration(path)
    mark = batch.read_mark(path)
    name = robot or (mark.id if mark else path.resolve().name)
    number = serial or (mark.serial if mark else name)
    day = measured or (mark.date if mark and mark.date else record.created[:10])
    try:
        when = date.fromisoformat(day)
    except ValueError:
        raise CalibrationError(f"expected a date such as 2026-03-17, found {day!r}", parameter="date") from None
    sha256 = hashlib.sha256(read_bytes(path / JSON_NAME, CalibrationError)).hexdigest()
    certainty = record.robot_calibrated().certainty
    assert certainty is not None
    sizes = _expected(record, certainty)
    fit = _estimate(certainty, sizes)
    return Stored(
        {"id": name, "serial": number, "type": record.robot.name},
        _head(record, path, when, sha256) | {"robot": name},
        fit,
        _level(record),
        _terms(record),
        tuple(_other(record, set(fit.names))),
        tuple((file.file, file.sha256) for file in record.data),
    )


def _estimate(certainty: Certainty, sizes: Mapping[str, float] | None = None, count: float = 1.0) -> Estimate:
    """Parameters of a certainty; ``count`` times their variance."""
    terms, nuisance = certainty.terms, len(certainty.covariance) - len(certainty.terms)
    natural = np.array([term.size for term in terms])
    expected = [sizes.get(term.group, 1.0) for term in terms] if sizes else [np.inf] * len(terms)
    return Estimate(
        tuple(name_of(term) for term in terms),
        tuple(term.unit for term in terms),
        np.array(certainty.coefficients),
        natural * expected,
        natural,
        count * np.array(certainty.covariance)[nuisance:, nuisance:],
    )


def _level(record: Record) -> Estimate | None:
    """The arm's own level fitted to the points of a calibration, a pose counted once.

    A level takes the points of a pose for independent, but their errors are mostly the pose's: its variances are too
    small by the number of points.
    """
    used = record.used_points(False)
    if used is None:
        return None
    points, arm = used[0], record.arm(calibrated=False)
    try:
        fit = identify(arm, points, default_level(arm))
    except IdentificationError:
        return None
    return _estimate(certainty_of(fit), count=max(1.0, len(points) / points.poses))


def _terms(record: Record) -> Estimate | None:
    """What all points of a calibration's last session show of the terms that a type is compared by."""
    arm = record.arm(calibrated=False)
    try:
        _, points, motion = earlier_of(record).sessions[-1]
        estimate = type_terms(arm, points, motion)
    except IrbcalError:
        return None
    natural = np.array([term.size for term in estimate.terms])
    return Estimate(
        tuple(name_of(term) for term in estimate.terms),
        tuple(term.unit for term in estimate.terms),
        np.array(estimate.values),
        WIDE * natural,
        natural,
        np.array(estimate.covariance),
    )


def _head(record: Record, folder: Path, measured: date, sha256: str) -> dict[str, Any]:
    proven, nominal, verdict = record.heldout, record.heldout_nominal, verdict_of(record)
    return {
        "fingerprint": record.fingerprint,
        "measured": measured,
        "created": record.created,
        "added": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "folder": str(folder.resolve()),
        "model": record.model,
        "method": record.method,
        "simulated": record.simulated,
        "poses_fit": record.poses_fit,
        "poses_heldout": record.poses_heldout,
        "nominal_mean_mm": nominal.all.mean_mm if nominal else None,
        "heldout_mean_mm": proven.all.mean_mm if proven else None,
        "heldout_sigma_mm": proven.all.sigma_mm if proven else None,
        "heldout_max_mm": proven.all.max_mm if proven else None,
        "trusted": verdict.trusted,
        "verdict": verdict.sentence(),
        "json_sha256": sha256,
        "urdf_sha256": record.calibrated_urdf_sha256,
        "nominal_urdf_sha256": record.robot.urdf_sha256,
    }


def _other(record: Record, names: set[str]) -> list[dict[str, Any]]:
    """Base, targets and what is held, as listed."""
    factor = {outside: (unit, size) for unit, (outside, size) in UNIT_OUTSIDE.items()}
    out: list[dict[str, Any]] = []
    for parameter in record.parameters:
        if parameter.name in names or not (parameter.name.startswith(("base", "target")) or parameter.state == "held"):
            continue
        unit, size = factor.get(parameter.unit, (parameter.unit, 1.0))
        std = None if parameter.std is None else parameter.std * size
        value = parameter.value * size
        out.append({"name": parameter.name, "value": value, "std": std, "unit": unit, "state": parameter.state})
    return out


def _expected(record: Record, certainty: Certainty) -> Mapping[str, float]:
    """Prior standard deviation of each group of an average of models, in natural sizes; empty for levels.

    A group that only some of the averaged models have is zero in the others, which its coefficients' second moments
    tell.
    """
    if record.evidence is None:
        return {}
    terms, nuisance = certainty.terms, len(certainty.covariance) - len(certainty.terms)
    natural = np.array([term.size for term in terms])
    moments = (np.diagonal(certainty.covariance)[nuisance:] + certainty.coefficients**2) / natural**2
    out = {}
    for group in record.evidence.groups:
        of_group = np.array([term.group == group.name and not high_wave(name_of(term)) for term in terms], dtype=bool)
        second_moment = group.estimate**2 + group.std**2
        share = float(moments[of_group].mean()) / second_moment if of_group.any() and second_moment > 0.0 else 1.0
        out[group.name] = group.size * min(1.0, share) ** 0.5
    return out


@dataclass(frozen=True, eq=False, repr=False)
class FleetAddition(Result):
    """What was added to a store.

    Attributes
    ----------
    store : str
    added, already_stored : tuple of str
        Folders that are new to it, and those that it had.
    """

    store: str
    added: tuple[str, ...]
    already_stored: tuple[str, ...]

    def report(self) -> Sequence[Paragraph]:
        """How many."""
        return [
            f"{counted(len(self.added), 'calibration')} added to {self.store}, {len(self.already_stored)} in it already"
        ]

    CONTENT = "store added already_stored"


@parallel.on_workers
def fleet_add(
    calibrations: Sequence[str | Path] | str | Path,
    store: str | Path = STORE,
    *,
    id: str | None = None,
    serial: str | None = None,
    date: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> FleetAddition:
    """Add calibrations to a store; those that it has already are not added again.

    Parameters
    ----------
    calibrations : str, Path or sequence of them
        Calibration folders, or folders of fleets, of which all calibrated robots are taken.
    store : str or Path
        File (SQLite; made where there is none), or ``postgresql+psycopg://USER@HOST/NAME``: fleet.db unless given.
    id : str, optional
        Which robot a single calibration is of: as the fleet's list says, or the folder's name, unless given.
    serial : str, optional
        Its serial number, the same in all of its calibrations: as the fleet's list says, or the id, unless given.
    date : str, optional
        When it was measured, as 2026-03-17: as the fleet's list says, or when it was calibrated, unless given.
    jobs : int, optional
        See `irbcal.parallel.using`.
    progress : callable, optional
        Called with a short text as they are added.

    Raises
    ------
    CalibrationError
        If one is no calibration, contradicts the store, or the store fails: those before it stay added.
    Interrupted
        After those under way were added.
    OptionError
        If ``id``, ``serial`` or ``date`` are given for several.
    """
    paths = [calibrations] if isinstance(calibrations, (str, Path)) else list(calibrations)
    folders = [folder for path in paths for folder in _folders(Path(path))]
    for option, value in (("id", id), ("serial", serial), ("date", date)):
        if value is not None and len(folders) != 1:
            raise OptionError(
                f"{option}: it is of a single calibration, found {len(folders)}; a fleet has it in its list",
                parameter=option,
            )
    for folder in folders:  # before anything is added
        if not (folder / JSON_NAME).is_file():
            raise CalibrationError("not a calibration folder", file=folder)
    new: dict[int, bool] = {}
    if not folders:
        raise OptionError("calibrations: expected one or more folders, found none", parameter="calibrations")
    first = stored(folders[0], id, serial, date)  # no store is made for what is none
    with opened(store, create=True) as database:
        waiting = {0: first}
        written = time.monotonic()

        def write() -> None:
            nonlocal written
            if not waiting:
                return
            new.update(zip(waiting, database.add_all(list(waiting.values())), strict=True))
            waiting.clear()
            written = time.monotonic()
            if progress is not None:
                progress(f"{len(new)} of {len(folders)} calibrations")

        try:
            for index, calibration in parallel.each(_stored, None, folders[1:], seconds=ADDITION_S):
                waiting[index + 1] = calibration
                if len(waiting) >= BATCH or time.monotonic() - written > BATCH_S:
                    write()
        except KeyboardInterrupt:
            write()
            raise parallel.Interrupted(len(folders) - len(new), "calibrations to add") from None
        except IrbcalError:
            write()  # those before it stay
            raise
        write()
    name = database.engine.url.render_as_string(hide_password=True) if "://" in str(store) else str(store)
    added, known_before = (tuple(str(folders[k]) for k in sorted(new) if new[k] is is_new) for is_new in (True, False))
    return FleetAddition(name, added, known_before)


ADDITION_S = 0.12
"""Seconds that refitting a calibration for the store takes, about."""
BATCH, BATCH_S = 200, 1.0
"""Calibrations that are added in one transaction at most, and seconds after which those that are ready are added."""


def _stored(_: None, folder: Path) -> Stored:
    """In a worker: a calibration folder as the store takes it."""
    return stored(folder)


def _folders(path: Path) -> list[Path]:
    """The calibration folders that a path stands for: itself, or those of a fleet."""
    from irbcal.fleet.batch import MARK, SIGN

    if (path / SIGN).is_file() and not (path / JSON_NAME).exists():
        folders = sorted(child for child in path.iterdir() if (child / MARK).is_file())
        if not folders:
            raise CalibrationError("this folder of a fleet has no calibrated robot", file=path)
        return folders
    return [path]
