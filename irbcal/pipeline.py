"""From measurements to a validated robot: read, clean, split, fit, check, validate.

Each step is a function from one frozen dataclass to the next. The next stands above the function: it has all that the
one before had, and what the step adds. `irbcal.calibrate` calls them in this order and records the result
(`irbcal.calibration_record`). Rows at features have steps of their own (`irbcal.feature_pipeline`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, Locked, locked
from irbcal.calibration_options import SPLITS, CalibrationOptions
from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.identification import commanded_poses
from irbcal.identification.axes import GROUPS
from irbcal.identification.choices import LEVELS
from irbcal.identification.evidence import Draft, check_averaging, draft_evidence, linearise, log_evidence
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.feature_sections import FeaturesSection
from irbcal.identification.fit import Fit, certainty_of, choose_level, identify, identify_by
from irbcal.identification.fit_sections import LevelChoice
from irbcal.identification.problem import session_names
from irbcal.identification.type_prior import TypePrior
from irbcal.io import prior_file, urdf
from irbcal.io.measurement_files import measurements_of
from irbcal.io.opening import Opened, calibration_at, open_robot
from irbcal.io.schema import Record
from irbcal.io.term_sections import FrameTermsSection
from irbcal.io.urdf import UrdfArm
from irbcal.measurement import cleaning, repeats, tools
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.input_table import read_targets
from irbcal.measurement.motions import motion_of, times_of, with_last_moves
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.poses import as_poses
from irbcal.measurement.reading_lag import mixed_use
from irbcal.measurement.repeats import repeat_groups, repeat_notes
from irbcal.measurement.session_blocks import into_one_frame
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling import coupling
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import default_level, selected_parameters
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import inputs as inputs_of_terms
from irbcal.modeling.terms.situation import Motion
from irbcal.names import check_names
from irbcal.option_values import Progress, checked
from irbcal.sessions import IN_EARLIER, Earlier, clean_sessions, earlier_of, without_outliers
from irbcal.units import DEG, MM
from irbcal.validation.accuracy import coverage, coverage_in_words
from irbcal.validation.doubts import cautions, doubts
from irbcal.wording import counted, inflected

if TYPE_CHECKING:
    from irbcal.measurement.features import FeatureSet

T = TypeVar("T")


def next_step(kind: type[T], inputs: Inputs, **changes: Any) -> T:
    """The dataclass of the next step."""
    return kind(**vars(inputs) | changes)


# --- read -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class Inputs(Locked):
    """What is read."""

    options: CalibrationOptions
    """As given; what is left open is as in the earlier calibration, where there is one."""
    urdf: UrdfArm
    """The nominal robot."""
    robot_file: Path
    nominal_source: tuple[str, str]
    """Name and SHA-256 of the nominal URDF."""
    measurements: MeasurementSet
    verification: MeasurementSet | None = None
    """Where the held-out poses come from a file of their own."""
    earlier: Earlier | None = None
    """The calibration that is added to."""
    known_targets: Mapping[str, FloatArray] | None = None
    """Metres, in the tip link."""
    prior: TypePrior | None = None
    feature_rows: FeatureSet | None = None
    """Where features were touched: the points then have no measured positions."""
    notes: tuple[str, ...] = ()
    """What the user should know; each step adds to it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        files = [Path(file.source).name for file in (self.measurements, self.verification) if file is not None]
        check_names(files, MeasurementError, parameter="measurements")


def read(options: CalibrationOptions, say: Progress) -> Inputs:
    """Open robot and measurements, with targets, prior and the earlier calibration that options name."""
    robot = options.robot
    folder = calibration_at(robot)
    if folder is not None and options.with_ is None:
        options = replace(options, with_=folder)
    earlier = None if options.with_ is None else earlier_of(options.with_)
    if earlier is not None:
        robot, options = earlier.robot() if robot is None else robot, _as_earlier(options, earlier.record)
    if robot is None:
        raise OptionError("robot: expected a URDF or the name of a robot, see irbcal robots", parameter="robot")
    opened = open_nominal(robot, options)
    nominal = opened.nominal_urdf
    if earlier is not None:
        earlier.check(nominal.arm)
    targets = read_targets(options.targets) if isinstance(options.targets, (str, Path)) else options.targets
    say("reading and cleaning the measurements")
    points = measurements_of(options.measurements, nominal.arm).of_arm(nominal.arm)
    if earlier is not None and any(data.sha256 == points.sha256 for data in earlier.record.data):
        raise MeasurementError(IN_EARLIER, file=points.source)
    return Inputs(
        options=options,
        urdf=nominal,
        robot_file=opened.file,
        nominal_source=opened.source,
        measurements=points,
        verification=None
        if options.verify is None
        else measurements_of(options.verify, nominal.arm).of_arm(nominal.arm),
        earlier=earlier,
        known_targets=targets,
        prior=prior_file.of_robot(options.prior, nominal.arm.name, opened.source[1], points.simulated),
        notes=tuple(robot_notes(opened)),
    )


def _as_earlier(options: CalibrationOptions, record: Record) -> CalibrationOptions:
    """The options of a calibration that adds to an earlier one: what is not given is as it was there."""
    changes: dict[str, Any] = {
        "base_link": record.robot.base_link,
        "tip_link": record.robot.tip_link,
        "model": record.model,
    }
    changes = {name: value for name, value in changes.items() if getattr(options, name) is None}
    if record.tool_shape_mm:
        changes["as_poses"] = True
    matrix = record.robot.coupling
    if options.coupling is None and matrix is not None and (np.diag(matrix) == 1.0).all():
        changes["coupling"] = coupling.in_words(np.array(matrix))
    if record.frame_terms is not None and changes.get("model", options.model) == "auto":
        changes["terms"] = "all"
    return replace(options, **changes)


def open_nominal(robot: str | Path, options: CalibrationOptions) -> Opened:
    """The robot with links, coupling and folders of packages of the options, nominal."""
    return open_robot(
        robot,
        nominal=True,
        base_link=options.base_link,
        tip_link=options.tip_link,
        coupling=options.coupling,
        package_dirs=options.package_dirs,
    )


def robot_notes(opened: Opened) -> list[str]:
    """Notes on a base link that moves, and on a robot that is of a calibration, or a URDF that a calibration wrote."""
    arm = opened.nominal
    notes = []
    if arm.joints_up:
        notes.append(
            f"{arm.base_link} moves with {arm.joint_names[0]}: gravity has no fixed direction in it, so no error model "
            "has terms of weight and loads."
        )
    if opened.record is not None:
        return [
            *notes,
            f"The robot is the one that the calibration {opened.file.resolve().parent.name} began from. Its "
            "measurements are fitted together with the new ones, so that its joint map is kept as far as they say so; "
            "held out are new poses only.",
        ]
    mark = urdf.fingerprint(opened.file.read_bytes(), str(opened.file))
    if mark is None:
        return notes
    return [
        *notes,
        f"The URDF is that of an earlier calibration ({mark[:8]}), whose joint map is not in it: what this calibration "
        "finds takes its place, and programs are corrected for a controller that computes with this URDF. To add "
        "measurements to the earlier one, use --with and its folder.",
    ]


# --- clean ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class CleanInputs(Inputs):
    """Cleaned points of all sessions, each in its own measuring frame."""

    points: PointSet
    motion: Motion
    """Of the points' poses."""
    proof: tuple[PointSet, Motion] | None = None
    """Those of ``verification``."""
    excluded: tuple[Exclusion, ...] = ()
    references: Mapping[str, FloatArray] = field(default_factory=dict)
    """Positions of the reference points of the last session, metres; empty without references."""
    tool_shape: Mapping[str, FloatArray] = field(default_factory=dict)
    """Positions of the reflectors on the tool where they were turned into poses, metres; else empty."""
    poses_measured: int = 0
    """Before cleaning, those of the earlier calibration included."""
    usual_kg: float | None = None
    """The payload of most poses."""


def clean(inputs: Inputs) -> CleanInputs:
    """Leave out what cannot be, session by session, and join it with the points of the earlier calibration."""
    options, arm, earlier = inputs.options, inputs.urdf.arm, inputs.earlier
    measurements, check = inputs.measurements, inputs.verification
    _check_loads(measurements, options)
    usual = tools.usual(measurements)
    sentences = tools.in_words(measurements, usual, options.same_tool)
    if not options.same_tool:
        measurements = tools.with_tool_per_load(measurements, usual)
        check = None if check is None else tools.with_tool_per_load(check, usual)
    cleaned = clean_sessions(
        measurements,
        arm,
        () if earlier is None else earlier.sessions,
        options.session_by,
        options.frame,
        options.as_poses,
        several_allowed=options.method != "circles",
        rule=options.outlier_rule,
    )
    earlier = None if earlier is None else replace(earlier, sessions=cleaned.earlier)
    notes = [*inputs.notes, *cleaned.notes, *sentences, *repeat_notes(cleaned.points)]
    excluded, proof = cleaned.excluded, None
    if check is not None:
        check_points = cleaning.clean(check, cleaned.references or None, cleaned.target_names)
        heldout, left_out, mixed_up = without_outliers(arm, check_points, check, options.outlier_rule)
        if options.as_poses:
            heldout, _ = as_poses(heldout, check.source, cleaned.tool_shape)
        heldout, fitted_too = _not_fitted(heldout, cleaned.points, arm.table.prismatic, check.source)
        notes += [f"{Path(check.source).name}: {note}" for note in [*mixed_up, *check_points.notes, *fitted_too]]
        notes += mixed_use(measurements.programmed, check.programmed, check.source)
        proof, excluded = (_of_last_session(heldout, cleaned.points), motion_of(check, heldout)), (*excluded, *left_out)
    return next_step(
        CleanInputs,
        inputs,
        measurements=measurements,
        verification=check,
        earlier=earlier,
        points=cleaned.points,
        motion=cleaned.motion,
        proof=proof,
        excluded=excluded,
        references=cleaned.references,
        tool_shape=cleaned.tool_shape,
        poses_measured=sum(points_in.poses for points_in in (measurements, check, earlier) if points_in is not None),
        usual_kg=usual,
        notes=tuple(notes),
    )


def _check_loads(measurements: MeasurementSet, options: CalibrationOptions) -> None:
    """Refuse options on the load that the measurements do not allow."""
    for name, quantity in inputs_of_terms().items():
        if quantity.on_request and getattr(options, name) and measurements.input(quantity.name) is None:
            raise MeasurementError(
                f"there are no {quantity.noun}: expected the columns {quantity.names(1)[0]} … of all joints",
                file=measurements.source,
                parameter=quantity.name,
            )
    if options.payload_centre is not None and measurements.input("payload_centre") is not None:
        raise OptionError(
            "payload_centre: the measurements give the payload's centre: leave it out",
            parameter="payload_centre",
        )
    if options.as_poses and not options.same_tool and tools.several_loads(measurements):
        raise OptionError(
            "as_poses: the poses carry several loads, so that the reflectors may have been remounted and are no one "
            "rigid body: give same_tool if they stayed where they were",
            parameter="as_poses",
        )


def _of_last_session(heldout: PointSet, points: PointSet) -> PointSet:
    """Points of a file of their own: measured in the last session, where there are several."""
    if points.session is None:
        return heldout
    number = {name: k for k, name in enumerate(points.target_names)}
    target = np.array([number[name] for name in heldout.target_names], dtype=int)[heldout.target]
    session = np.full(heldout.poses, points.session[-1], dtype=object)
    return replace(heldout, target=target, target_names=points.target_names, session=session)


def _not_fitted(heldout: PointSet, points: PointSet, prismatic: BoolArray, source: str) -> tuple[PointSet, list[str]]:
    """Poses for the proof without those that are fitted."""
    repeated = repeats.near_fitted(heldout, points, prismatic)
    count, n = int(repeated.sum()), heldout.poses
    if not count:
        return heldout, []
    if count == n:
        raise MeasurementError(
            f"all {n} poses are at joints of fitted poses (within {repeats.NEAR[0] / DEG:g} degrees, up to full "
            "turns), so they prove nothing: measure other poses, or leave verify away and hold some of the "
            "measurements out",
            file=source,
        )
    return heldout.select(~repeated).with_seen_targets(), [
        f"{count} of its {n} poses are at joints of fitted poses: they prove nothing and are left out."
    ]


# --- split ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class SplitInputs(CleanInputs):
    """Points to fit, and points to prove with, which may be none."""

    fit_points: PointSet
    heldout_points: PointSet
    fit_motion: Motion
    heldout_motion: Motion
    """Of their poses; ``elapsed`` is the number of each pose in its session."""
    per_file: tuple[PointSet, ...] = ()
    """Each file's in the order of measuring."""


def split(cleaned: CleanInputs) -> SplitInputs:
    """Hold poses out, unless they come from a file of their own; of an addition those at places of new poses."""
    options, points, motion = cleaned.options, cleaned.points, cleaned.motion
    moves = np.isin(points.groups.astype(str), GROUPS)
    by_axes = options.method == "circles" and moves.any()
    fit = moves if by_axes else np.ones(points.poses, dtype=bool)
    if cleaned.proof is not None:
        heldout, heldout_motion = cleaned.proof
    else:
        if not by_axes:
            new = np.arange(points.poses) >= (0 if cleaned.earlier is None else cleaned.earlier.poses)
            of_new = held_out(points.select(new), options.share, options.split, options.seed)
            position = repeat_groups(points)
            fit = ~np.isin(position, position[new][of_new])
        heldout, heldout_motion = points.select(~fit), motion.select(~fit)
    return next_step(
        SplitInputs,
        cleaned,
        fit_points=points.select(fit),
        heldout_points=heldout,
        fit_motion=motion.select(fit),
        heldout_motion=heldout_motion,
        per_file=(points,) if cleaned.proof is None else (points, heldout),
    )


def held_out(points: PointSet, holdout: float, order: str = "random", seed: int = 0) -> BoolArray:
    """Which poses are held out: places, each with all its repeats (`irbcal.measurement.repeats.repeat_groups`).

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
        If the held-out poses cannot be as asked for.
    OptionError
        If the order is another one.
    """
    checked("split", order, SPLITS)
    position = repeat_groups(points)
    n = int(position.max(initial=-1)) + 1
    count = round(holdout * n) if holdout < 1 else int(holdout)
    if holdout < 0 or count >= n:
        kind = "poses" if n == points.poses else f"places (of {points.poses} poses, repeats of one place together)"
        raise MeasurementError(f"cannot hold out {count} of {n} usable {kind}: some must be left for the fit")
    mask = np.zeros(n, dtype=bool)
    if order == "last":
        mask[n - count :] = True
    else:
        mask[np.random.default_rng(seed).permutation(n)[:count]] = True
    return mask[position]


# --- programmed joints, before points are cleaned -------------------------------------------------------------


def with_commands(inputs: Inputs, say: Progress) -> Inputs:
    """Programmed joints from the poses that the controller was sent to, as far as the evidence is for them.

    Readings, commands, or a share of both: the share is chosen on the poses that are fitted.
    """
    measurements, arm, check = inputs.measurements, inputs.urdf.arm, inputs.verification
    goal = None if measurements.programmed else commanded_poses.goals(measurements)
    if goal is None:
        return inputs
    if inputs.earlier is not None:
        return replace(
            inputs, notes=(*inputs.notes, "Commanded poses are not taken where an earlier calibration is added to.")
        )
    q = measurements.joints()
    commands = commanded_poses.commands(arm, q, goal)
    if commands is None or commands.misfit > commanded_poses.LARGEST_MISFIT:
        size = "" if commands is None else f": the median is {commands.misfit / MM:.3g} mm from the readings' poses"
        return replace(inputs, notes=(*inputs.notes, f"Commanded poses do not belong to these joints{size}."))
    say("comparing readings and commanded poses")

    def sets(share: float) -> Inputs:
        changed = check
        goal_of_check = None if check is None or check.programmed else commanded_poses.goals(check)
        if check is not None and goal_of_check is not None:
            others = commanded_poses.commands(arm, check.joints(), goal_of_check, commands)
            assert others is not None
            changed = check.with_programmed(check.joints() + share * others.difference)
        programmed = measurements.with_programmed(q + share * commands.difference)
        return replace(inputs, measurements=programmed, verification=changed)

    of_shares = [clean(sets(share)) for share in commanded_poses.SHARES]
    # what is compared is of the same points: cleaning may depend on the joints, positions do not
    positions = [_positions_by_pose(cleaned.points) for cleaned in of_shares]
    compared = set(_positions_by_pose(split(clean(inputs)).fit_points)).intersection(*positions)
    evidence = [
        _evidence(cleaned, np.array([pose in compared for pose in poses]))
        for cleaned, poses in zip(of_shares, positions, strict=True)
    ]
    best = commanded_poses.best_share(np.array(evidence))
    difference = np.abs(commands.difference[commands.solved]) / arm.joint_units
    about = (
        f"{int(commands.solved.sum())} of {len(q)} commanded poses give programmed joints, "
        f"{np.median(difference):.2g} degrees or mm from the readings in the median"
    )
    gain = max(evidence) - evidence[0]
    if best < commanded_poses.LEAST or gain < commanded_poses.LEAST_GAIN:
        return replace(inputs, notes=(*inputs.notes, f"{about}; the evidence is not for them: the readings are taken."))
    return replace(
        sets(best),
        notes=(
            *inputs.notes,
            f"{about}; the model takes {best:.0%} of the way from readings to commands (log evidence +{gain:.0f}).",
        ),
    )


def _evidence(cleaned: CleanInputs, compared: BoolArray) -> float:
    """Log evidence of the model that is asked for, or of a level the likelihood, from the poses that are compared."""
    options, arm, targets = cleaned.options, cleaned.urdf.arm, cleaned.known_targets
    points, motion = cleaned.points.select(compared), cleaned.motion.select(compared)
    model, usual = _model(options, arm, points.poses)[0], cleaned.usual_kg
    if model == "auto":
        centre, seed = options.payload_centre, options.seed
        return log_evidence(linearise(arm, points, motion, options.terms, targets, centre, usual, seed))
    level = default_level(arm) if model == "best-level" else checked("model", model, LEVELS)
    return -3.0 * len(points) * float(np.log(identify(arm, points, level, known_targets=targets).rms))


def _positions_by_pose(points: PointSet) -> list[bytes]:
    """The measured positions of each pose, to the last digit: equal where it is the same pose with the same points."""
    order = np.argsort(points.pose, kind="stable")
    ends = np.cumsum(np.bincount(points.pose, minlength=points.poses))[:-1]
    return [xyz.tobytes() for xyz in np.split(points.xyz[order], ends)]


# --- fit ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class Fitted(SplitInputs):
    """The identified robot. From here on all points are in the measuring frame of the last session."""

    fit: Fit | EvidenceFit
    """The level asked for, or model ``auto``."""
    nominal_robot: Robot
    """The nominal robot with base and tool from the same points."""
    nominal_fit: Fit | None = None
    """Base and tool alone; None where these come from no fit of points."""
    choice: LevelChoice | None = None
    """The comparison of levels, where the level was chosen by it."""
    sessions: tuple[str, ...] = ()
    """Names of all sessions, the last one last; empty where there is one only."""


def fit(inputs: SplitInputs, say: Progress) -> Fitted:
    """Identify base and tool with the nominal arm, then the error model that is asked for."""
    options, arm, source = inputs.options, inputs.urdf.arm, inputs.measurements.source
    points, heldout, targets = inputs.fit_points, inputs.heldout_points, inputs.known_targets
    strange = [name for name in targets or {} if name not in points.target_names]
    if strange:
        raise MeasurementError(
            f"the known target {strange[0]} was not measured; targets are {', '.join(points.target_names)}",
            file=source,
            parameter="targets",
        )
    say(f"identifying base and tool from {points.poses} poses")
    nominal = identify(arm, points, "nominal", known_targets=targets)
    _refuse_orientations(nominal, points, source)
    choice, (model, notes) = None, _model(options, arm, points.poses)
    if model == "best-level":
        choice = choose_level(arm, points, options.seed, progress=say, known_targets=targets)
        model = choice.level
    say(f"identifying model {model}")
    sessions = () if points.session is None else session_names(points)
    screened, draft = _refitted_without_outliers(inputs, _identified(inputs, model, say), model, say)
    identified = draft.fit() if isinstance(draft, Draft) else draft
    if screened is not inputs:
        inputs, points = screened, screened.fit_points
        nominal = identify(arm, points, "nominal", known_targets=targets)
    all_points = inputs.per_file
    if identified.other_bases:
        frames = identified.robot.T_world_base, identified.other_bases
        all_points = tuple(replace(into_one_frame(each, *frames), session=each.session) for each in all_points)
        points, heldout = into_one_frame(points, *frames), into_one_frame(heldout, *frames)
        nominal = identify(arm, points, "nominal", known_targets=targets)
    unseen = [name for name in heldout.target_names if name not in identified.robot.targets]
    if unseen:
        raise MeasurementError(f"target {unseen[0]} is measured in held-out poses only: hold out fewer poses")
    heldout, moves = with_last_moves(identified.robot, heldout)
    return next_step(
        Fitted,
        inputs,
        fit_points=points,
        heldout_points=heldout,
        per_file=all_points,
        fit=identified,
        nominal_robot=nominal.robot,
        nominal_fit=nominal,
        choice=choice,
        sessions=sessions,
        notes=(*inputs.notes, *moves, *notes),
    )


LARGEST_TURN = 3 * DEG
"""Median angle from the nominal robot above which measured orientations are refused, radians."""


def _refuse_orientations(nominal: Fit, points: PointSet, source: str) -> None:
    """Measured orientations that have nothing to do with the robot, such as a constant default in an export."""
    points = into_one_frame(points, nominal.robot.T_world_base, nominal.other_bases)
    angles = rotation_distances(nominal.robot, points)
    if len(angles) and np.median(angles) > LARGEST_TURN:
        raise MeasurementError(
            f"the orientations contradict the robot by {np.median(angles) / DEG:.3g} degrees (median): leave these "
            "columns out if they were not measured",
            file=source,
            column=("qw", "qx", "qy", "qz"),
        )


def _model(options: CalibrationOptions, arm: Arm, poses: int) -> tuple[str, list[str]]:
    """The model that is asked for, or ``auto``; where that cannot serve the level for this arm, and a note why."""
    if options.model is not None:
        return str(options.model), []
    level, of_level = default_level(arm), options.of_levels
    if options.method == "circles":
        if not arm.six_revolute:
            raise OptionError(
                f"method circles is for arms with six revolute joints, {arm.name} has {arm.joints_listed}",
                parameter="method",
            )
        return "26", ["Method circles takes all link geometry from the axes (model 26), and nothing beyond geometry."]
    prefix = f"Model {level} was taken, not the default, which averages many error models (auto): "
    if of_level:
        return level, [f"{prefix}{' and '.join(of_level)} {inflected(len(of_level), 'belongs', 'belong')} to a level."]
    try:
        check_averaging(arm, poses)
    except IdentificationError as error:
        if options.prior is not None:
            raise OptionError(
                f"prior: it is for model auto, and {error}, without the prior", parameter="prior"
            ) from None
        return level, [f"{prefix}{error}."]
    return "auto", []


def _identified(inputs: SplitInputs, model: str, say: Progress) -> Fit | Draft:
    """The fit of a level, or the average of error models."""
    options, arm, points, heldout = inputs.options, inputs.urdf.arm, inputs.fit_points, inputs.heldout_points
    if model == "auto":
        asked = {
            name: values
            for name, values in inputs.fit_motion.inputs.items()
            if not inputs_of_terms()[name].on_request or getattr(options, name)
        }
        motion = replace(inputs.fit_motion, inputs=asked)
        centre, usual, known = options.payload_centre, inputs.usual_kg, inputs.known_targets
        say("fitting the geometry")
        linearised = linearise(arm, points, motion, options.terms, known, centre, usual, options.seed)
        return draft_evidence(linearised, prior=inputs.prior, rule=options.outlier_rule, progress=say)
    groups = sorted({str(name) for name in heldout.groups if name})
    watched = {name: heldout.select(heldout.groups == name).without_empty_poses() for name in groups}
    if len(groups) < 2:  # the history of a fit tells all together
        watched = {"held-out": heldout} if heldout.poses else {}
    identified = identify_by(
        arm,
        points,
        checked("model", model, LEVELS),
        options.method,
        options.goal,
        known_targets=inputs.known_targets,
        parameters=selected_parameters(model, options.free, options.hold, arm),
        watched=watched,
        parallel=options.parallel,
    )
    return replace(identified, robot=identified.robot.replace(certainty=certainty_of(identified)))


ROUNDS = 5
"""How often a fit is repeated without outliers."""


def _refitted_without_outliers(
    inputs: SplitInputs, identified: Fit | Draft, model: str, say: Progress
) -> tuple[SplitInputs, Fit | Draft]:
    """The fit without outliers that show among its own residuals: smaller ones than those left out before."""
    start = inputs, identified
    excluded: list[Exclusion] = []
    for _ in range(ROUNDS):
        points = inputs.fit_points
        if not isinstance(identified, Draft) or not identified.outlier_distance.any():
            break
        distances_off = identified.outlier_distance
        wrong = distances_off > 0.0
        excluded += [
            Exclusion(
                pose=str(points.pose_ids[points.pose[k]]),
                target=points.target_names[points.target[k]],
                reason=f"outlier: {distance / MM:.3g} mm from where the model puts it that all other poses give",
            )
            for k, distance in zip(np.flatnonzero(wrong), distances_off[wrong], strict=True)
        ]
        good = points.take(~wrong).with_seen_targets()
        too_many = inputs.options.outlier_rule.too_many(len(excluded), len(start[0].fit_points))
        if too_many or good.target_names != points.target_names:
            return start
        say(f"identifying model {model} without {len(excluded)} outliers")
        poses = np.isin(np.arange(points.poses), good.pose)
        inputs = replace(inputs, fit_points=good.select(poses), fit_motion=inputs.fit_motion.select(poses))
        identified = _identified(inputs, model, say)
    if not excluded:
        return start
    names = ", ".join(f"{point.pose}/{point.target}" for point in excluded)
    contradict = ("point contradicts all others and was left out", "points contradict all others and were left out")
    note = f"{counted(len(excluded), *contradict)} (pose/target {names})."
    return replace(inputs, excluded=(*inputs.excluded, *excluded), notes=(*inputs.notes, note)), identified


# --- check ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class CheckedFit(Fitted):
    """What speaks against the result, whatever its errors say."""

    doubts: tuple[str, ...] = ()
    coverage: Mapping[str, Any] | None = None
    """Whether intervals hold on the held-out poses, see `irbcal.validation.accuracy.coverage`."""


def check(fitted: Fitted) -> CheckedFit:
    """Look for what speaks against the result, and what to know of it."""
    assert fitted.nominal_fit is not None
    timed = [(fitted.fit_points, fitted.fit_motion), (fitted.heldout_points, fitted.heldout_motion)]
    times = times_of(fitted.per_file, timed if fitted.verification is None else timed[:1])
    against = doubts(fitted.nominal_fit, fitted.fit, fitted.fit_points, fitted.per_file, times)
    covered = coverage(fitted.fit.robot, fitted.heldout_points)
    notes = (*fitted.notes, *cautions(fitted.nominal_fit, fitted.fit), *_worth_knowing(fitted, covered))
    return next_step(CheckedFit, fitted, doubts=tuple(against), notes=notes, coverage=covered)


def _worth_knowing(fitted: Fitted, covered: Mapping[str, Any] | None) -> list[str]:
    """Whether intervals hold; of an average: gears, joint ranges, and whether readings lag."""
    fit, heldout = fitted.fit, fitted.heldout_points
    notes = [f"Of the held-out poses, {coverage_in_words(covered)}"] if covered else []
    if not isinstance(fit, EvidenceFit):
        return notes
    frame_terms = FrameTermsSection.of_robot(fit.robot)
    notes = [*([] if frame_terms is None else [frame_terms.in_words]), *fit.sentences(), *notes]
    lag = fit.lag()
    if lag is None:
        return notes
    note = (
        f"The joints of this file are readings from before the arm stood still: with a share of the last move free in "
        f"each pose residuals fall by a factor of {fit.average.readings_gain:.1f}. The model is right at programmed "
        "joints; errors at these readings are mostly theirs."
    )
    if heldout.poses:
        at_programmed = replace(heldout, q=lag.programmed(fit, fitted.heldout_motion))
        mean = float(distances(fit.robot, at_programmed).mean())
        note += f" At joints estimated from the readings the held-out mean is {mean / MM:.3f} mm."
    return [*notes, note]


# --- validate -------------------------------------------------------------------------------------------------


class PointErrors(NamedTuple):
    """Distances of points from the robot, or of rows from their features, metres, shape (points,) each."""

    fit: FloatArray
    fit_nominal: FloatArray
    heldout: FloatArray
    heldout_nominal: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Validated(CheckedFit):
    """Everything that comes out of a calibration, ready to be recorded."""

    errors: PointErrors
    features: FeaturesSection | None = None
    """Where features were touched."""

    def __repr__(self) -> str:
        poses = f"{self.fit_points.poses} fitted and {self.heldout_points.poses} held-out poses"
        return f"<Validated {self.robot_file.name}, model {self.fit.level}: {poses}>"


def validate(checked: CheckedFit) -> Validated:
    """Compute the errors of fitted and of held-out points, of the calibrated robot and of the nominal one."""
    robots = checked.fit.robot, checked.nominal_robot
    errors = [
        distances(robot, points) if len(points) else np.zeros(0)
        for points in (checked.fit_points, checked.heldout_points)
        for robot in robots
    ]
    return next_step(Validated, checked, errors=PointErrors(*map(locked, errors)))
