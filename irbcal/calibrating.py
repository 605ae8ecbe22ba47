"""The main job, from measurements to a proven calibration."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.gathering import gathered, of_earlier, refuse_orientations, without_gross_errors
from irbcal.identification.axes import GROUPS
from irbcal.identification.axis_calibration import PARALLELS
from irbcal.identification.choices import (
    ALIASES,
    LEVELS,
    LOSSES,
    METHODS,
    MODELS,
    OBJECTIVES,
    TERMS,
    method_of,
)
from irbcal.identification.evidence import check_averaging, identify_evidence
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.fit import Fit, certainty_of, identify, identify_by
from irbcal.identification.problem import session_names
from irbcal.identification.selection import choose_level
from irbcal.identification.type_prior import TypePrior
from irbcal.io import prior_file, robots
from irbcal.io.calibration_folder import URDF_NAME, CalibrationLike
from irbcal.io.earlier import Earlier, calibrated_before, earlier_of, taken_from
from irbcal.io.opening import calibration_at, read_nominal
from irbcal.io.outcome import Outcome
from irbcal.io.schema import FrameTermsSection
from irbcal.measurement import cleaning, fitted, lists, table, tools
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.columns import TableLike
from irbcal.measurement.motions import motion_of, times_of
from irbcal.measurement.order import with_last_moves
from irbcal.measurement.places import notes as repeat_notes
from irbcal.measurement.places import places
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.poses import as_poses
from irbcal.measurement.reading_lag import mixed_use
from irbcal.measurement.sessions import into_one_frame
from irbcal.measurement.table import MeasurementSet, MeasurementsLike
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import default_level, selected_parameters
from irbcal.modeling.terms.situation import Motion
from irbcal.options import checked, names, number, place
from irbcal.options import seed as check_seed
from irbcal.units import DEG, MM
from irbcal.validation.coverage import coverage, coverage_in_words
from irbcal.validation.doubts import cautions, doubts

SPLITS = ("random", "last")
HOLDOUT = 0.25
"""Share of the poses that are held out unless another is asked for."""

Progress: TypeAlias = Callable[[str], Any]
"""Called with a short text at each step."""


@dataclass(frozen=True, eq=False)
class Options:
    """How to calibrate; see `irbcal.calibrate` for what each option means."""

    model: str | int | None = None
    terms: str = "joint-map"
    holdout: float | None = None
    split: str = "random"
    seed: int = 0
    verify: MeasurementsLike | None = None
    base_link: str | None = None
    tip_link: str | None = None
    coupling: str | None = None
    method: str = "least-squares"
    objective: str = "rms"
    power: float = 8.0
    loss: str = "linear"
    free: Sequence[str] = ()
    hold: Sequence[str] = ()
    targets: str | Path | Mapping[str, FloatArray] | None = None
    frame: Sequence[str] | None = None
    as_poses: bool = False
    session_by: str | None = None
    with_: CalibrationLike | None = None
    payload_place: Sequence[float] | None = None
    same_tool: bool = False
    torques: bool = False
    parallel: str = "hayati"
    features: TableLike | None = None
    leave_out: str | None = None
    prior: str | Path | TypePrior | None = None

    def __post_init__(self) -> None:
        if isinstance(self.model, int):
            object.__setattr__(self, "model", str(self.model))
        for name, value, choices in (
            ("model", self.model, (None, *MODELS)),
            ("terms", self.terms, TERMS),
            ("split", self.split, SPLITS),
            ("method", self.method, (*METHODS, *ALIASES)),
            ("objective", self.objective, OBJECTIVES),
            ("loss", self.loss, LOSSES),
            ("parallel", self.parallel, PARALLELS),
        ):
            if value not in choices:
                raise OptionError.unknown(name, value, [choice for choice in choices if choice is not None])
        if self.model == "auto":
            for option in self.of_a_level:
                raise OptionError(
                    f"{option}: model auto averages error models by their evidence and takes no {option}: choose "
                    "a level, such as 34, for that",
                    parameter=option,
                )
        if method_of(self.method) == "circles" and self.model not in (None, "26"):
            raise OptionError(
                f"model: method circles takes all link geometry from the axes (model 26): leave out model {self.model}"
                " or the method",
                parameter="model",
            )
        if self.parallel != PARALLELS[0] and method_of(self.method) != "circles":
            raise OptionError("parallel: only method circles forces parallel axes", parameter="parallel")
        if self.terms != TERMS[0] and (self.model not in (None, "auto") or self.of_a_level):
            level = f"model {self.model}" if self.model not in (None, "auto") else self.of_a_level[0]
            raise OptionError(f"terms: {self.terms} are for model auto, leave out {level} or terms", parameter="terms")
        if self.payload_place is not None:
            place("payload_place", self.payload_place, "x, y, z of the payload's centre in the tip link in metres")
        self._check_holdout()
        own = f"model {self.model}" if self.model not in (None, "auto") else next(iter(self.of_a_level), None)
        own = own if self.terms == TERMS[0] else f"terms {self.terms}"
        if self.prior is not None and own is not None:
            raise OptionError(f"prior: it is for model auto of terms joint-map: leave out {own}", parameter="prior")
        check_seed(self.seed)
        if self.leave_out is not None and self.features is None:
            raise OptionError("leave_out: only rows at features have places: name --features", parameter="leave_out")
        number("power", self.power, 2.0)
        both = set(names("free", self.free)) & set(names("hold", self.hold))
        if both:
            raise OptionError(f"hold: {min(both)} is to be freed, too: choose one", parameter="hold")
        if self.frame is not None and len(names("frame", self.frame)) != 3:
            raise OptionError(
                f"frame: expected the names of three reference points, found {len(self.frame)}", parameter="frame"
            )

    def _check_holdout(self) -> None:
        share = self.share
        if self.holdout is not None and self.verify is not None:
            raise OptionError(
                "holdout: the measurements of verify are the proof, none are held out: leave one out",
                parameter="holdout",
            )
        try:
            if number("holdout", share, 0, 1e9) >= 1:
                number("holdout", share, whole=True)
        except OptionError:
            raise OptionError(
                f"holdout: expected a fraction below 1 or a whole number, found {share!r}", parameter="holdout"
            ) from None

    @property
    def of_a_level(self) -> tuple[str, ...]:
        """Names of the given options that only a level of the error model takes."""
        choices = (
            ("method", method_of(self.method), "least-squares"),
            ("objective", self.objective, "rms"),
            ("loss", self.loss, "linear"),
            ("free", tuple(self.free), ()),
            ("hold", tuple(self.hold), ()),
        )
        return tuple(option for option, given, own in choices if given != own)

    @property
    def share(self) -> float:
        """Share or number of the poses to hold out: `HOLDOUT` unless given."""
        return HOLDOUT if self.holdout is None else self.holdout


@dataclass
class _Prepared:
    """Cleaned points, divided into those to fit and those to prove with."""

    measurements: MeasurementSet
    fit: PointSet
    heldout: PointSet
    whole: list[PointSet]
    """Each file's in the order of measuring."""
    fit_motion: Motion
    heldout_motion: Motion
    excluded: list[Exclusion]
    notes: list[str]
    poses_asked: int
    references: Mapping[str, FloatArray]
    tool_shape: Mapping[str, FloatArray] = field(default_factory=dict)
    verification: MeasurementSet | None = None
    usual_kg: float | None = None


def split(points: PointSet, holdout: float, order: str = "random", seed: int = 0) -> BoolArray:
    """Which poses are held out: places, each with all its repeats (`irbcal.measurement.places.places`).

    Parameters
    ----------
    points : PointSet
    holdout : float or int
        A fraction below 1, or a number, of places; without repeats that is of poses.
    order : {"random", "last"}
        ``random``: drawn with the seed; ``last``: the last places of the file.
    seed : int

    Returns
    -------
    ndarray of bool, shape (n,)
        True for held-out poses.

    Raises
    ------
    MeasurementError
        If the wish cannot be met.
    OptionError
        If the order is another one.
    """
    checked("split", order, SPLITS)
    place = places(points)
    n = int(place.max(initial=-1)) + 1
    count = round(holdout * n) if holdout < 1 else int(holdout)
    if holdout < 0 or count >= n:
        kind = "poses" if n == points.poses else f"places (of {points.poses} poses, repeats of one place together)"
        raise MeasurementError(f"cannot hold out {count} of {n} usable {kind}: some must be left for the fit")
    mask = np.zeros(n, dtype=bool)
    if order == "last":
        mask[n - count :] = True
    else:
        mask[np.random.default_rng(seed).permutation(n)[:count]] = True
    return mask[place]


def run(
    measurements: MeasurementsLike, robot: str | Path | None, options: Options, progress: Progress | None = None
) -> Outcome:
    """The main job: read, clean, divide, identify, doubt; parameters and errors as `irbcal.calibrate`."""
    if options.features is not None:
        from irbcal import feature_calibration

        feature_calibration.check(options, Options())
        return feature_calibration.run(measurements, robot, options, progress)
    started = time.perf_counter()
    say: Progress = progress or (lambda text: None)
    saved = calibration_at(robot)
    if saved is not None and options.with_ is None:
        options = replace(options, with_=saved.folder)
    earlier = None if options.with_ is None else earlier_of(options.with_)
    robot, options = of_earlier(robot, options, earlier)
    saved = calibration_at(robot)
    robot_urdf = read_nominal(robot, options.base_link, options.tip_link, options.coupling)
    arm = robot_urdf.arm
    if earlier is not None:
        earlier.check(arm)
    known = lists.read_targets(options.targets) if isinstance(options.targets, (str, Path)) else options.targets
    say("reading and cleaning the measurements")
    ready = _prepared(measurements, arm, options, earlier)
    robot_file = robots.robot_file(robot) if saved is None else saved.folder / URDF_NAME
    ready.notes = [*(calibrated_before(robot_file) if saved is None else taken_from(saved)), *ready.notes]
    source = ready.measurements.source
    sessions = () if ready.fit.session is None else session_names(ready.fit)
    sha256 = hashlib.sha256(robot_file.read_bytes()).hexdigest() if saved is None else saved.record.robot.urdf_sha256
    prior = prior_file.of_robot(options.prior, arm.name, sha256, ready.measurements.simulated)
    say(f"identifying base and tool from {ready.fit.poses} poses")
    _check_known_targets(known, ready.fit, source)
    nominal = identify(arm, ready.fit, "nominal", known_targets=known)
    refuse_orientations(nominal, ready.fit, source)
    choice, (model, why) = None, _model(options, arm, ready.fit.poses)
    if model == "best-level":
        choice = choose_level(arm, ready.fit, options.seed, progress=say, known_targets=known)
        model = choice.level
    say(f"identifying model {model}")
    fit = _identified(arm, ready, model, options, known, say, prior)
    if fit.other_bases:
        ready.fit, ready.heldout = (
            into_one_frame(points, fit.robot.T_world_base, fit.other_bases) for points in (ready.fit, ready.heldout)
        )
        ready.whole = [
            replace(into_one_frame(points, fit.robot.T_world_base, fit.other_bases), session=points.session)
            for points in ready.whole
        ]
        nominal = identify(arm, ready.fit, "nominal", known_targets=known)
    unseen = [name for name in ready.heldout.target_names if name not in fit.robot.targets]
    if unseen:
        raise MeasurementError(f"target {unseen[0]} is measured in held-out poses only: hold out fewer poses")
    ready.heldout, moves = with_last_moves(fit.robot, ready.heldout)
    ready.notes += moves
    timed = [(ready.fit, ready.fit_motion), (ready.heldout, ready.heldout_motion)]
    times = times_of(ready.whole, timed if ready.verification is None else timed[:1])
    doubtful = doubts(nominal, fit, ready.fit, ready.whole, times, ready.heldout)
    return Outcome(
        robot_urdf,
        robot_file,
        fit,
        nominal,
        ready.fit,
        ready.heldout,
        ready.measurements,
        ready.verification,
        ready.poses_asked,
        tuple(ready.excluded),
        dict(ready.references),
        dict(ready.tool_shape),
        choice,
        tuple(doubtful + ready.notes + why + cautions(nominal, fit) + _worth_knowing(fit, ready)),
        time.perf_counter() - started,
        dict(fit.other_bases),
        sessions,
        (ready.fit_motion.elapsed, ready.heldout_motion.elapsed),
        earlier,
        tuple(doubtful),
        None if saved is None else (saved.record.robot.urdf, saved.record.robot.urdf_sha256),
    )


def _model(options: Options, arm: Arm, poses: int) -> tuple[str, list[str]]:
    """The model that is asked for, or ``auto``; where that cannot serve the level for this arm, and a note why."""
    if options.model is not None:
        return str(options.model), []
    level, own = default_level(arm), options.of_a_level
    if method_of(options.method) == "circles":
        return "26", ["Method circles takes all link geometry from the axes (model 26), and nothing beyond geometry."]
    taken = f"Model {level} was taken, not the default, which averages many error models (auto): "
    if own:
        return level, [f"{taken}{' and '.join(own)} belong{'s' if len(own) == 1 else ''} to a level."]
    try:
        check_averaging(arm, poses)
    except IdentificationError as error:
        if options.prior is not None:
            raise OptionError(
                f"prior: it is for model auto, and {error}, without the prior", parameter="prior"
            ) from None
        return level, [f"{taken}{error}."]
    return "auto", []


def _identified(
    arm: Arm,
    ready: _Prepared,
    model: str,
    options: Options,
    known: Mapping[str, FloatArray] | None,
    say: Progress,
    prior: TypePrior | None,
) -> Fit | EvidenceFit:
    """The fit of a level, or the average of error models."""
    if model == "auto":
        motion = ready.fit_motion if options.torques else replace(ready.fit_motion, torques=None)
        return identify_evidence(
            arm,
            ready.fit,
            motion,
            terms=options.terms,
            seed=options.seed,
            known_targets=known,
            payload_place=options.payload_place,
            usual_kg=ready.usual_kg,
            prior=prior,
            progress=say,
        )
    fit = identify_by(
        arm,
        ready.fit,
        checked("model", model, LEVELS),
        method_of(options.method),
        checked("objective", options.objective, OBJECTIVES),
        options.power,
        checked("loss", options.loss, LOSSES),
        known_targets=known,
        parameters=selected_parameters(model, options.free, options.hold, arm),
        watched=_groups(ready.heldout),
        parallel=checked("parallel", options.parallel, PARALLELS),
    )
    return replace(fit, robot=fit.robot.replace(certainty=certainty_of(fit)))


def _prepared(measurements: MeasurementsLike, arm: Arm, options: Options, earlier: Earlier | None = None) -> _Prepared:
    seen = _read(measurements, arm)
    tools.check(seen, options.model in (None, "auto"), options)
    usual = tools.usual(seen)
    words = tools.in_words(seen, usual, options.same_tool)
    seen = seen if options.same_tool else tools.with_tool_per_load(seen, usual)
    found = gathered(seen, arm, options, () if earlier is None else earlier.sessions)
    points, motion, references, shape = found.points, found.motion, found.references, found.tool_shape
    excluded, notes = found.excluded, [*found.notes, *words, *repeat_notes(points)]
    moves = np.isin(points.groups.astype(str), GROUPS)
    by_axes = method_of(options.method) == "circles" and moves.any()
    if options.verify is None:
        aside = ~moves if by_axes else _aside(points, options, earlier)
        parts = points.select(~aside), points.select(aside)
        motions = motion.select(~aside), motion.select(aside)
        poses = seen.poses + (0 if earlier is None else earlier.poses)
        return _Prepared(seen, *parts, [points], *motions, excluded, notes, poses, references, shape, usual_kg=usual)
    check = _read(options.verify, arm)
    check = check if options.same_tool else tools.with_tool_per_load(check, usual)
    other = cleaning.clean(check, references or None, found.target_names)
    heldout, left_out, swaps = without_gross_errors(arm, other, check)
    if options.as_poses:
        heldout, _ = as_poses(heldout, check.source, shape)
    heldout, seen_note = _never_seen(heldout, points, arm.table.prismatic, check.source)
    notes += [f"{Path(check.source).name}: {note}" for note in [*swaps, *other.notes, *seen_note]]
    notes += mixed_use(seen.programmed, check.programmed, check.source)
    poses = seen.poses + check.poses + (0 if earlier is None else earlier.poses)
    used = moves if by_axes else np.ones(points.poses, dtype=bool)
    heldout = _of_last_session(heldout, points)
    sets = points.select(used), heldout, [points, heldout], motion.select(used), motion_of(check, heldout)
    return _Prepared(seen, *sets, excluded + left_out, notes, poses, references, shape, check, usual)


def _aside(points: PointSet, options: Options, earlier: Earlier | None) -> BoolArray:
    """Which poses are held out; of an addition to an earlier calibration those at places of new poses."""
    if earlier is None:
        return split(points, options.share, options.split, options.seed)
    new = np.arange(points.poses) >= earlier.poses
    place = places(points)
    aside = split(points.select(new), options.share, options.split, options.seed)
    return np.isin(place, place[new][aside])


def _of_last_session(heldout: PointSet, points: PointSet) -> PointSet:
    """Points of a file of their own: measured in the last session, where there are several."""
    if points.session is None:
        return heldout
    number = {name: k for k, name in enumerate(points.target_names)}
    target = np.array([number[name] for name in heldout.target_names], dtype=int)[heldout.target]
    session = np.full(heldout.poses, points.session[-1], dtype=object)
    return replace(heldout, target=target, target_names=points.target_names, session=session)


def _never_seen(heldout: PointSet, fit: PointSet, prismatic: BoolArray, source: str) -> tuple[PointSet, list[str]]:
    """Poses for the proof without those that are fitted."""
    seen = fitted.poses_of(heldout, fit, prismatic)
    count, n = int(seen.sum()), heldout.poses
    if not count:
        return heldout, []
    if count == n:
        raise MeasurementError(
            f"all {n} poses are at joints that are fitted (within {fitted.NEAR[0] / DEG:g} degrees, up to full turns), "
            "so they prove nothing: measure other poses, or leave verify away and hold some of the measurements out",
            file=source,
        )
    return heldout.select(~seen).with_seen_targets(), [
        f"{count} of its {n} poses are at joints that are fitted, and are counted out: no proof."
    ]


def _read(measurements: MeasurementsLike, arm: Arm) -> MeasurementSet:
    seen = table.read(measurements)
    seen = seen.of_arm(arm)
    return seen


def _groups(points: PointSet) -> dict[str, PointSet]:
    """Points by group, for the history of a fit; all together where there are no groups."""
    groups = sorted({str(name) for name in points.groups if name})
    if len(groups) < 2:
        return {"held-out": points} if points.poses else {}
    return {name: points.select(points.groups == name).without_empty_poses() for name in groups}


def _check_known_targets(known: Mapping[str, FloatArray] | None, points: PointSet, source: str) -> None:
    """Known targets that were never measured are a slip of the pen."""
    strange = [name for name in known or {} if name not in points.target_names]
    if strange:
        raise MeasurementError(
            f"the known target {strange[0]} was not measured; targets are {', '.join(points.target_names)}",
            file=source,
            parameter="targets",
        )


def _worth_knowing(fit: Fit | EvidenceFit, ready: _Prepared) -> list[str]:
    """Whether intervals hold; of an average: gears, joint ranges, and whether readings lag."""
    heldout = ready.heldout
    held = coverage(fit.robot, heldout)
    notes = [f"Of the poses kept aside, {coverage_in_words(held)}"] if held else []
    if not isinstance(fit, EvidenceFit):
        return notes
    frame_terms = FrameTermsSection.of_robot(fit.robot)
    notes = [*([] if frame_terms is None else [frame_terms.in_words]), *fit.sentences(), *notes]
    lag = fit.lag()
    if lag is None:
        return notes
    note = (
        f"The joints of this file are readings from before the arm stood still: with a share of the last move free in "
        f"each pose residuals fall by a factor of {fit.readings_gain:.1f}. The model is right at programmed "
        "joints; errors at these readings are mostly theirs."
    )
    if heldout.poses:
        at_programmed = replace(heldout, q=lag.programmed(fit, ready.heldout_motion))
        mean = float(distances(fit.robot, at_programmed).mean())
        note += f" At joints estimated from the readings the held-out mean is {mean / MM:.3f} mm."
    return [*notes, note]
