"""Options of `irbcal.calibrate`: each is declared here, and nowhere else.

A field is an option: its type, default and marks; the text below it says what it means. From these come the function's
signature and docstring, the command line with its help, the options that a list of robots may have, and what is
refused. An option that goes with others only is refused in `CalibrationOptions.__post_init__`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, get_args

from irbcal.declared_options import EVERYDAY, MEASUREMENTS, MODEL, Bounds, changed_options, check_fields
from irbcal.errors import OptionError
from irbcal.identification.choices import FitMethod, Goal, Loss, ModelName, Objective, Parallel, Terms
from irbcal.option_values import Progress, names, number, point_in_metres

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray
    from irbcal.identification.outlier_rule import OutlierRule
    from irbcal.identification.type_prior import TypePrior
    from irbcal.io.measurement_files import MeasurementFiles
    from irbcal.io.opening import CalibrationLike
    from irbcal.measurement.input_table import TableLike
    from irbcal.measurement.table import MeasurementsLike

HoldoutSplit: TypeAlias = Literal["random", "last"]
"""Which poses are held out."""
SPLITS: tuple[HoldoutSplit, ...] = get_args(HoldoutSplit)
HOLDOUT = 0.25
"""Share of the poses that are held out unless another is asked for."""

AT_FEATURES = "rows at features take it"
OF_LEVELS = "levels of the error model take it, model auto does not"
OF_AUTO = "model auto takes it, levels do not"


@dataclass(frozen=True, eq=False)
class CalibrationOptions:
    """What is calibrated, and how."""

    measurements: Annotated[MeasurementFiles, AT_FEATURES]
    """A measurement file, or several that hold points and joints together (in Python also a table, or a result that
    holds measurements): in irbcal's own format, or as other programs write them. These are recognised, as
    `irbcal.import_measurements` does, and a note says what was understood.
    """
    robot: Annotated[str | Path | None, EVERYDAY, AT_FEATURES] = None
    """URDF file, a robot's name (`irbcal.robots`), or a calibration, as for ``with_``. Left out only with ``with_``."""
    model: Annotated[ModelName | int | None, MODEL, AT_FEATURES] = None
    """``auto``, the default: the average of many error models by their evidence, docs/calibration-auto.md. A level:
    ``nominal``, ``11``, ``16``, ``26``, ``34``, ``34b`` (six revolute joints), ``offsets``, ``placement`` (any
    serial arm). ``best-level``: the level that cross-validation over the poses of the fit chooses. Where no model
    is named, options of a level (``method``, ``objective``, ``loss``, ``free``, ``hold``) and fewer than ten poses
    lead to ``34``, or ``placement`` for arms that are not built for it; a note says so.
    """
    _: KW_ONLY
    holdout: Annotated[float | None, EVERYDAY] = None
    """Fraction or number of poses that the fit does not see: 0.25 unless given; not with ``verify``."""
    verify: Annotated[MeasurementsLike | None, EVERYDAY] = None
    """A file of its own for the held-out poses, measured with the same tool, registered to the first's references."""
    with_: Annotated[CalibrationLike | None, EVERYDAY] = None
    """An earlier calibration: its points are fitted together with the new measurements, as sessions before them. Robot
    and model are its own unless given; held out are new poses only.
    """
    prior: Annotated[str | Path | TypePrior | None, MODEL, OF_AUTO] = None
    """What calibrated robots of the same type show (`irbcal.fleet_prior`), for model ``auto``: fewer poses do. A robot
    that is not like its type is identified without, and said to stand out.
    """
    features: Annotated[TableLike | None, MEASUREMENTS, AT_FEATURES] = None
    """What is known of features that were touched, see `irbcal.measurement.features`: no tracker is needed."""
    targets: Annotated[str | Path | Mapping[str, FloatArray] | None, MEASUREMENTS] = None
    """Places of the reflectors measured on the tool itself: a file with columns target, x_mm, y_mm, z_mm (in Python
    also a dict of places in metres).
    """
    frame: Annotated[Sequence[str] | None, MEASUREMENTS] = None
    """Reference points that define the measuring frame, see `irbcal.measurement.poses.in_frame_of`."""
    as_poses: bool = False
    """Turn the points of each pose into one full pose first, see `irbcal.measurement.poses.as_poses`."""
    session_by: Annotated[str | None, MEASUREMENTS] = None
    """Column that names the session of each row, with a base and a tool of its own (docs/sessions.md). By default
    ``session`` where there is one, and ``group`` where groups differ by far; ``none`` for one session.
    """
    payload_centre: Annotated[Sequence[float] | None, MEASUREMENTS, AT_FEATURES, OF_AUTO] = None
    """Centre of the payloads (column ``payload_kg``) in the tip link where the measurements do not tell it, metres."""
    same_tool: Annotated[bool, MEASUREMENTS] = False
    """The reflectors stayed where they were when the load was changed. Otherwise each load has a tool of its own."""
    base_link: Annotated[str | None, AT_FEATURES] = None
    """See `irbcal.read_urdf`."""
    tip_link: Annotated[str | None, AT_FEATURES] = None
    """See `irbcal.read_urdf`."""
    coupling: Annotated[str | None, AT_FEATURES] = None
    """See `irbcal.read_urdf`."""
    package_dirs: Annotated[Sequence[str | Path], AT_FEATURES] = ()
    """Folders in which packages of the robot's description are looked up first: of a xacro file, and of meshes, whose
    folders the calibration remembers.
    """
    terms: Annotated[Terms, MODEL, AT_FEATURES, OF_AUTO] = "joint-map"
    """What model ``auto`` may consist of. ``joint-map``: URDF and joint map are the whole truth, for every program.
    ``all``: frame terms, too (bending, wobble), which only irbcal's own kinematics knows.
    """
    split: HoldoutSplit = "random"
    """Which poses are held out: drawn at random, or the last of the file."""
    seed: Annotated[int, Bounds(0), AT_FEATURES] = 0
    """Of the random split."""
    method: Annotated[FitMethod, MODEL, OF_LEVELS] = "least-squares"
    """How to identify, see `irbcal.identification.fit.identify_by`. With ``circles`` the fit sees the one-joint
    moves (groups ``axis1`` ... ``axis6``) only, and all other poses are held out; the model is then ``26``.
    """
    objective: Annotated[Objective, MODEL, AT_FEATURES, OF_LEVELS] = "rms"
    """What to minimise: the root mean square, the largest error, or a norm between them."""
    power: Annotated[float, Bounds(2.0), AT_FEATURES] = 8.0
    """Power of ``pnorm``, 2 or more."""
    loss: Annotated[Loss, AT_FEATURES, OF_LEVELS] = "linear"
    """What an error counts in the root mean square: ``soft_l1`` and ``huber`` bend less to outliers."""
    free: Annotated[Sequence[str], MODEL, AT_FEATURES, OF_LEVELS] = ()
    """Error parameters added to the level, by name or pattern, such as ``gain*``."""
    hold: Annotated[Sequence[str], MODEL, AT_FEATURES, OF_LEVELS] = ()
    """Error parameters that stay at nominal, likewise."""
    torques: Annotated[bool, OF_AUTO] = False
    """Use the torques that the robot reports (columns ``tau1_nm`` …): predictions then need them. A mass is better."""
    parallel: Parallel = "hayati"
    """Method ``circles``: keep the tilt of nearly parallel axes, or give them one direction."""
    leave_out: Annotated[str | None, AT_FEATURES] = None
    """Column of the places that are held out in turn, see `irbcal.validation.feature_proof.prove`."""
    jobs: Annotated[int | None, AT_FEATURES] = None
    """See `irbcal.parallel.using`."""
    progress: Annotated[Progress | None, AT_FEATURES] = None
    """Called with a short text at each step."""

    def __post_init__(self) -> None:
        if isinstance(self.model, int):
            object.__setattr__(self, "model", str(self.model))
        check_fields(self)
        if self.payload_centre is not None:
            point_in_metres(
                "payload_centre", self.payload_centre, "x, y, z of the payload's centre in the tip link in metres"
            )
        if self.frame is not None and len(names("frame", self.frame)) != 3:
            raise OptionError(
                f"frame: expected the names of three reference points, found {len(self.frame)}", parameter="frame"
            )
        twice = set(self.free) & set(self.hold)
        if twice:
            raise OptionError(f"hold: {min(twice)} is to be freed, too: choose one", parameter="hold")
        if self.robot is None and self.with_ is None:
            raise OptionError("robot: name the nominal robot, or an earlier calibration to add to", parameter="robot")
        if "power" in changed_options(self) and self.objective != "pnorm":
            raise OptionError("power: only objective pnorm has a power", parameter="power")
        self._check_holdout()
        self._check_model()
        self._check_features()

    def _check_holdout(self) -> None:
        if self.holdout is not None and self.verify is not None:
            raise OptionError(
                "holdout: the measurements of verify are the proof, none are held out: leave one out",
                parameter="holdout",
            )
        try:
            if number("holdout", self.share, 0, 1e9) >= 1:
                number("holdout", self.share, whole=True)
        except OptionError:
            raise OptionError(
                f"holdout: expected a fraction below 1 or a whole number, found {self.share!r}", parameter="holdout"
            ) from None

    def _check_model(self) -> None:
        """What goes with model auto only, with levels only, and with method circles."""
        if self.model == "auto":
            for option in self.of_levels:
                raise OptionError(
                    f"{option}: model auto averages error models by their evidence and takes no {option}: choose "
                    "a level, such as 34, for that",
                    parameter=option,
                )
        level = f"model {self.model}" if self.model not in (None, "auto") else next(iter(self.of_levels), None)
        for option in changed_options(self, OF_AUTO) if level is not None else ():
            raise OptionError(f"{option}: only model auto takes it: leave it out, or {level}", parameter=option)
        if self.prior is not None and self.terms != "joint-map":
            raise OptionError(f"prior: it is for terms joint-map: leave out terms {self.terms}", parameter="prior")
        if self.method == "circles" and self.model not in (None, "26"):
            raise OptionError(
                f"model: method circles takes all link geometry from the axes (model 26): leave out model {self.model}"
                " or the method",
                parameter="model",
            )
        if self.parallel != "hayati" and self.method != "circles":
            raise OptionError("parallel: only method circles forces parallel axes", parameter="parallel")

    def _check_features(self) -> None:
        if self.features is None:
            if self.leave_out is not None:
                raise OptionError(
                    "leave_out: only rows at features have places: name --features", parameter="leave_out"
                )
            return
        taken = changed_options(self, AT_FEATURES)
        for option in changed_options(self):
            if option not in taken:
                raise OptionError(
                    f"{option.rstrip('_')}: rows at features do not take it, leave it out", parameter=option
                )
        if self.model in ("best-level", "nominal"):
            raise OptionError(
                f"model: rows at features take auto or a level of error parameters, not {self.model}", parameter="model"
            )

    @property
    def of_levels(self) -> list[str]:
        """Names of the given options that only a level of the error model takes."""
        return changed_options(self, OF_LEVELS)

    @property
    def goal(self) -> Goal:
        """What a fit of rows at features makes small."""
        return Goal(self.objective, self.power, self.loss)

    @property
    def outlier_rule(self) -> OutlierRule:
        """From where on a measurement is an outlier."""
        from irbcal.identification.outlier_rule import RULE

        return RULE

    @property
    def share(self) -> float:
        """Share or number of the poses to hold out: `HOLDOUT` unless given."""
        return HOLDOUT if self.holdout is None else self.holdout
