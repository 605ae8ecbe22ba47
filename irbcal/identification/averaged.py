"""The robot that an average of error models describes: model ``auto``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import dictionaries, shown
from irbcal.identification.evidence import COMPARED, Progress, identify_evidence
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.like_sisters import Prior
from irbcal.identification.readings import Lag, lag
from irbcal.identification.result import ParameterReport
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.sessions import into_one_frame
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import Motion
from irbcal.summary import Speaks, Table, Told
from irbcal.units import MM, UNIT_OUTSIDE

if TYPE_CHECKING:
    import pandas as pd

FEWEST = 10
"""Poses below which there is nothing to compare."""


@dataclass(frozen=True, eq=False, repr=False)
class AveragedFit(Speaks):
    """An identified robot as the average of error models, with what the identification knows about itself.

    It has the names of `irbcal.identification.result.Fit` that a saved calibration needs.

    Attributes
    ----------
    evidence : EvidenceFit
    points : PointSet
        Those of the fit, in the measuring frame of the last session.
    motion : Motion
        Of their poses.
    level, method, objective : str
    value, lower_bound, least_squares, history : None
        What other ways to identify have.
    """

    evidence: EvidenceFit
    points: PointSet
    motion: Motion
    level: Literal["auto"] = "auto"
    method: Literal["evidence"] = "evidence"
    objective: Literal["rms"] = "rms"
    value: None = None
    lower_bound: None = None
    least_squares: None = None
    history: None = None

    def __post_init__(self) -> None:
        lock(self)

    @cached_property
    def robot(self) -> Robot:
        """The calibrated robot, warm, with a joint map of terms and, of terms ``all``, with frame terms."""
        found, terms = self.evidence, self.evidence.term_map()
        joint_map = JointMap(terms.part(False), found.joint_ranges, found.usual_kg)
        frame_terms = terms.part(True)
        return Robot(
            found.arm,
            joint_map,
            found.T_world_base,
            found.targets,
            found.target_rotations,
            found.certainty,
            frame_terms if frame_terms.terms else None,
        )

    def warmth(self, points: PointSet, elapsed: FloatArray) -> FloatArray | None:
        """By how much points lie elsewhere while the arm warms up.

        Parameters
        ----------
        points : PointSet
        elapsed : ndarray, shape (n,)
            When its poses were measured, as the fit's motion counts.

        Returns
        -------
        ndarray, shape (m, 3), or None
            Metres, in the measuring frame; None where there are no terms of warm-up.
        """
        found = self.evidence
        if all(term.family != "warm_up" for term in found.terms):
            return None
        at_use = found.motion(points.q, points.previous, **points.load())
        T = found.term_map(warm=False).forward(found.arm, replace(at_use, elapsed=elapsed))
        away = found.T_world_base @ (T - found.term_map().forward(found.arm, at_use))
        targets = np.array([found.targets[name] for name in points.target_names])[points.target]
        away = away[points.pose]
        return np.asarray(np.einsum("mij,mj->mi", away[:, :3, :3], targets) + away[:, :3, 3])

    @property
    def _flat(self) -> int:
        return len(self.evidence.covariance) - len(self.evidence.terms)

    @property
    def _used(self) -> list[int]:
        """Terms that are left at use: all but the warm-up."""
        return [k for k, term in enumerate(self.evidence.terms) if term.family != "warm_up"]

    @property
    def rank(self) -> int:
        """Number of coefficients that the data determine, base and targets included, rounded."""
        return self._flat + round(sum(group.seen for group in self.evidence.groups if group.name != "warm_up"))

    @property
    def parameter_count(self) -> int:
        """Number of parameters, base and targets included, warm-up excluded."""
        return self._flat + len(self._used)

    @property
    def rms(self) -> float:
        """Root mean square distance of the fitted points from the warm robot, metres."""
        return float(np.sqrt(np.mean(distances(self.robot, self.points) ** 2)))

    def covariance(self) -> FloatArray:
        """Of base (turn, shift in the base link), free targets, target frames and the parameters, SI units."""
        return self.evidence.certainty.covariance

    def held(self) -> list[str]:
        """Nothing is held: what the data do not show stays near nominal, with the standard deviation it had before."""
        return []

    def parameters(self) -> list[ParameterReport]:
        """Base, targets, constants of the geometry and terms of the joint map with standard deviations."""
        found = self.evidence
        rows = self._outer()
        units = [term.unit for term in found.terms if term.family == "geometry"]
        for (name, (value, deviation)), unit in zip(found.constants().items(), units, strict=True):
            rows.append(_row(name, value, deviation, unit))
        std = found.std
        rows += [
            _row(found.terms[k].name, found.coefficients[k], std[k], found.terms[k].unit)
            for k in self._used
            if found.terms[k].family != "geometry"
        ]
        return rows

    def _outer(self) -> list[ParameterReport]:
        """Base and targets, which have no nominal values."""
        found = self.evidence
        std = np.sqrt(np.maximum(np.diagonal(found.covariance), 0.0))

        def angles(R: FloatArray, outside: bool, at: int) -> FloatArray:
            D = frames.angles_derivative(R, outside)
            return np.sqrt(np.maximum(np.diag(D @ found.covariance[at : at + 3, at : at + 3] @ D.T), 0.0))

        def base(label: str, T: FloatArray, at: int) -> list[ParameterReport]:
            C = found.covariance[at + 3 : at + 6, at + 3 : at + 6]
            shift = np.sqrt(np.maximum(np.diagonal(T[:3, :3] @ C @ T[:3, :3].T), 0.0))
            place = frames.to_xyz_angles(T)
            turned = angles(T[:3, :3], False, at)
            return [
                *(_row(f"{label}_{name}", place[k], shift[k], "m") for k, name in enumerate("xyz")),
                *(_row(f"{label}_r{name}", place[3 + k], turned[k], "rad") for k, name in enumerate("xyz")),
            ]

        rows, at = base("base", found.T_world_base, 0), 6
        for name in found.free_targets:
            place = found.targets[name]
            rows += [_row(f"target_{name}_{'xyz'[k]}", place[k], std[at + k], "m") for k in range(3)]
            at += 3
        for name in found.framed_targets:
            R = found.target_rotations[name]
            found_angles, turned = frames.to_xyz_angles(frames.transform(R))[3:], angles(R, True, at)
            rows += [_row(f"target_{name}_r{'xyz'[k]}", found_angles[k], turned[k], "rad") for k in range(3)]
            at += 3
        for session, T in found.other_bases.items():
            rows += base(f"base@{session}", T, at)
            at += 6
        return rows

    @property
    def other_bases(self) -> Mapping[str, FloatArray]:
        """Base (4, 4) in the measuring frame of each session but the last one."""
        return self.evidence.other_bases

    def lag(self) -> Lag | None:
        """How readings lag behind programmed joints, where they were found to; else None."""
        return lag(self.evidence, self.points, self.motion) if self.evidence.readings_projected else None

    def explanation(self) -> str:
        """Why these error models, in two sentences."""
        rows = self.evidence.dictionaries
        kept = sorted((row for row in rows if row.weight > 0.0), key=lambda row: -row.weight)
        first = kept[0]
        told = (
            f"Of {len(rows)} error models the evidence of these poses supports {first.name} ({first.weight:.0%}) most"
        )
        told += f", and with it {len(kept) - 1} more" if len(kept) > 1 else ""
        plain = rows[0]
        gain = first.log_evidence - plain.log_evidence
        warm = len(self._used) < len(self.evidence.terms)
        left = " The parameters leave out the warm-up's terms." if warm else ""
        better = "" if plain is first else f", here by {gain:.0f} nats better than {plain.name} alone"
        return (
            f"{told}. Their evidence says how well each foretells these measurements without knowing them{better}; all "
            f"with weight are averaged, because the best one alone is often best by accident.{left}"
        )

    def sentences(self) -> list[str]:
        """What a user should know of it: gears that were found, and where it is valid."""
        found = self.evidence
        units, slides = found.nominal.joint_units, found.nominal.table.prismatic
        low, high = found.joint_ranges / units
        ranges = ", ".join(
            f"joint {j + 1} {low[j]:.1f} to {high[j]:.1f} {'mm' if slides[j] else 'deg'}" for j in range(len(units))
        )
        warm = []
        if found.tau is not None:
            warm.append(
                f"The arm drifted as it warmed up, with a time constant of {found.tau:.0f} poses: the calibration is "
                "that of the warm arm, so that the first poses miss it by more."
            )
        some = []
        if found.poses > COMPARED:
            some.append(
                f"Error models were compared on {COMPARED} of the {found.poses} poses, drawn at random; those that are "
                "averaged were fitted to all."
            )
        return [
            *([] if found.sisters is None else [found.sisters.in_words()]),
            shown.sentence(found.families),
            *some,
            *found.gear_sentences(),
            *warm,
            *self._loads(),
            f"Valid within the joint ranges of the fitted poses: {ranges}. Beyond them the joint map is extrapolated "
            "and must not be trusted.",
        ]

    def _loads(self) -> list[str]:
        """What loads it is valid for."""
        found = self.evidence
        torques = [
            "It takes the torques that the robot reports. Where none are given they count as zero, which no arm's are: "
            "predictions without them miss what the joints give way."
        ]
        torques = torques if any(term.basis == "torque" for term in found.terms) else []
        if not found.loads:
            return torques
        if len(found.loads) == 1:
            return [
                *torques,
                f"All poses were measured with a payload of {found.loads[0]:g} kg: the calibration is that of the "
                "robot with this load, and does not tell what another one does.",
            ]
        some = ", ".join(f"{load:g}" for load in found.loads)
        return [
            *torques,
            f"Measured with payloads of {some} kg: where no payload is given, predictions and corrections are for "
            f"{found.usual_kg:g} kg, which most poses were measured with (of all loads, if as many); other loads: "
            "--payload.",
        ]

    def told(self) -> Sequence[Told]:
        """The models that were averaged, what the data show of each group of terms, and gears in words."""
        found = self.evidence
        headline = (
            f"{found.nominal.name}, model auto: {self.rank} of {self.parameter_count} parameters determined by "
            f"{found.poses} poses (fitted rms {self.rms / MM:.3f} mm)"
        )
        return (headline, self.explanation(), self._models(), self._groups(), *self.sentences())

    def _models(self) -> Table:
        rows = self.evidence.dictionaries
        return models_table([(r.name, r.terms, r.log_evidence, r.weight, _mm(r.sigma), _mm(r.loo)) for r in rows])

    def _groups(self) -> Table:
        return groups_table([(g.name, g.terms, g.seen, g.size) for g in self.evidence.groups])

    def to_frame(self) -> pd.DataFrame:
        """The parameters, a row each: name, value, unit, std, state and reason."""
        import pandas as pd

        return pd.DataFrame([asdict(row) for row in self.parameters()])


def models_table(rows: Sequence[tuple[str, int, float, float, float | None, float | None]]) -> Table:
    """The error models compared, as a table for people.

    Parameters
    ----------
    rows : sequence of (name, terms, log evidence, weight, sigma, leave-one-out error)
        The errors in millimetres, None for models without weight.
    """
    cells = tuple(
        (name, terms, f"{evidence:.1f}", f"{weight:.3f}", sigma, loo)
        for name, terms, evidence, weight, sigma, loo in rows
    )
    columns = ("error model", "terms", "log evidence", "weight", "sigma (mm)", "leave one out (mm)")
    bold = frozenset(k for k, row in enumerate(rows) if row[3] > 0.0)
    return Table("Error models compared by their evidence", columns, cells, digits=4, bold=bold)


def groups_table(rows: Sequence[tuple[str, int, float, float]]) -> Table:
    """Groups of terms as a table for people: name, terms, how many of them the data determine, prior size."""
    cells = tuple((name.replace("_", " "), terms, f"{seen:.1f}", size) for name, terms, seen, size in rows)
    return Table("Groups of terms", ("group", "terms", "of them seen", "size (natural sizes)"), cells)


def _mm(length: float | None) -> float | None:
    return None if length is None else length / MM


def _row(name: str, value: float, std: float, unit: str) -> ParameterReport:
    outside, factor = UNIT_OUTSIDE.get(unit, (unit, 1.0))
    return ParameterReport(name, float(value) / factor, outside, float(std) / factor, "identified", "")


def check_averaging(arm: Arm, poses: int) -> None:
    """Refuse what cannot be averaged by evidence.

    Raises
    ------
    IdentificationError
        If the poses are too few to weigh error models, or all axes of the arm are parallel.
    """
    if poses < FEWEST:
        raise IdentificationError(
            f"{poses} poses are too few to weigh error models against each other, which needs at least {FEWEST}: "
            "measure more, or choose model placement"
        )
    if arm.planar:
        raise IdentificationError(
            "all axes of this arm are parallel, so that base and tool cannot be told apart, and the evidence of error "
            "models has no meaning: choose model placement"
        )


def identify_averaged(
    arm: Arm,
    points: PointSet,
    motion: Motion,
    known_targets: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    terms: str = dictionaries.JOINT_MAP,
    payload_place: Sequence[float] | None = None,
    usual_kg: float | None = None,
    prior: Prior | None = None,
) -> AveragedFit:
    """Identify base, targets and the average of error models.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    motion : Motion
        Of the points' poses.
    known_targets : dict of str to array_like, shape (3,), optional
        Targets whose places in the tip link are known, metres.
    seed : int
        Of the poses on which models are compared where there are very many.
    progress : callable, optional
        Called with a short text at each step.
    terms : str
        ``joint-map``: what URDF and a joint map can carry; ``all``: frame terms, too.
    payload_place, usual_kg, prior : optional
        See `irbcal.identification.evidence.identify_evidence`.

    Returns
    -------
    AveragedFit

    Raises
    ------
    IdentificationError
        As `check_averaging`, or if the poses do not determine base and targets.
    """
    check_averaging(arm, points.poses)
    known = None if known_targets is None else {k: np.asarray(v, dtype=float) for k, v in known_targets.items()}
    found = identify_evidence(
        arm,
        points,
        motion,
        terms=terms,
        seed=seed,
        known_targets=known,
        payload_place=payload_place,
        usual_kg=usual_kg,
        prior=prior,
        progress=progress,
    )
    return AveragedFit(found, into_one_frame(points, found.T_world_base, found.other_bases), motion)
