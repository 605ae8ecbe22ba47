r"""What is known of a robot's predictions: covariance, 95 % intervals, and the joint ranges that they hold in.

The interval of a coordinate is ``1.96 sqrt(V + B + loo^2 / 3)``: V is the scatter of the parameters, B the disagreement
of averaged error models (one covariance holds both) and loo the root mean square length of the residuals of poses that
were left out of the fit one at a time. The scatter of the parameters alone holds 18 to 77 % of held-out coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from irbcal.arrays import BoolArray, FloatArray, Locked
from irbcal.distributions import NORMAL_95
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import bases, chain
from irbcal.modeling.terms.situation import GRAVITY, Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import BLOCK, TermModel
from irbcal.section import Name, Section
from irbcal.summary import Paragraph, Result
from irbcal.units import MM

OUTSIDE = 0.01
"""Degrees or millimetres beyond the joint ranges of a fit that still count as within."""


def bounded_history(terms: Sequence[Term]) -> BoolArray:
    """Which terms are between -1 and 1 times their coefficient, and unknown without the stop before, shape (terms,)."""
    return np.array([bases()[term.basis].bounded_history for term in terms], dtype=bool)


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Result):
    """Where a target will be."""

    position: FloatArray
    """Shape (n, 3). In the measuring frame (of the tip: in the base link), metres."""
    covariance: FloatArray
    """Shape (n, 3, 3). Scatter of the parameters and disagreement of the averaged error models, m^2."""
    interval: FloatArray
    """Shape (n, 3). Half-width that holds 95 % of a coordinate's errors: 1.96 times the root of the covariance's
    diagonal and a third of the squared leave-one-out error, metres.
    """
    outside: BoolArray
    """Shape (n,). Whether a joint is outside the range of the fit, where high harmonics must not be trusted."""

    def report(self) -> Sequence[Paragraph]:
        """How wide the intervals are, and whether poses are outside the joint ranges of the fit."""
        width = self.interval / MM
        headline = f"{len(width)} predicted positions"
        if len(width):
            headline += (
                f": 95 % of a coordinate's errors within {np.median(width):.3f} mm (largest {width.max():.3f} mm)"
            )
        count = int(self.outside.sum())
        if not count:
            return (headline,)
        return (headline, f"{count} of them outside the joint ranges of the fit: their intervals may not hold.")

    COLUMNS = "x_mm,y_mm,z_mm=position x_u95_mm,y_u95_mm,z_u95_mm=interval outside"


class FitLimits(Section):
    """What intervals of predictions need beside the covariance, and where they are valid.

    Leave-one-out errors (mm) are root mean square lengths by target, under the empty name for all: of single poses, and
    of contiguous fifths of each session; empty where not known, None where what is left does not determine them.
    ``ranges`` are the smallest and the largest joints of the fit, rad (m). ``measurement_noise_mm`` is the standard
    deviation of a measured coordinate that distances between targets at one pose prove
    (`irbcal.measurement.points.PointSet.distance_noise`), zero where they prove none.
    """

    leave_one_out_mm: dict[Name, float | None]
    leave_fifths_out_mm: dict[Name, float | None]
    ranges: list[list[float]] = Field(min_length=2, max_length=2)
    measurement_noise_mm: float = Field(default=0.0, ge=0.0)


@dataclass(frozen=True, eq=False, repr=False)
class Certainty(Locked):
    """What an identification knows of the robot that it found."""

    nominal: Arm
    """Attitudes of links are taken from it."""
    terms: tuple[Term, ...]
    """What the last columns of the covariance are coefficients of: constants of the geometry (errors of the DHM table)
    and terms of the joint map and the frames.
    """
    covariance: FloatArray
    """Shape (nuisance + terms, nuisance + terms). Of the base (turn, shift in the base link), places of the free
    targets, turns of target frames, and the coefficients, SI units.
    """
    fitted_targets: tuple[str, ...]
    """Targets whose places were identified, in the order of their columns."""
    coefficients: FloatArray
    """Shape (terms,). Their sizes join the uncertainty where the last move is not known."""
    limits: FitLimits
    gravity: tuple[float, ...] = GRAVITY
    """Direction in the base link."""

    @cached_property
    def _term_model(self) -> TermModel:
        return TermModel(self.nominal, self.terms)

    def __repr__(self) -> str:
        counts = f"{len(self.terms)} coefficients, {len(self.fitted_targets)} fitted targets"
        return f"<Certainty of {self.nominal.name}: {counts}>"

    # ---------------------------------------------------------------- joint ranges

    def beyond(self, q: FloatArray) -> FloatArray:
        """How far joints (n, joints) lie outside the ranges of the fit, radians (metres); zeros within, (n, joints)."""
        low, high = np.array(self.limits.ranges)
        far = np.maximum(q - high, low - q)
        return np.where(far > OUTSIDE * self.nominal.joint_units, far, 0.0)

    def outside(self, q: FloatArray) -> BoolArray:
        """Which poses have a joint outside the ranges of the fit, shape (n,)."""
        return np.asarray(self.beyond(q).any(axis=1))

    def outside_in_words(self, q: FloatArray, noun: str = "poses") -> str:
        """How many poses lie outside, in which joints and by how much; an empty text where none does."""
        beyond = self.beyond(q)
        count = int(beyond.any(axis=1).sum())
        if not count:
            return ""
        units, slides = self.nominal.joint_units, self.nominal.table.prismatic
        ranges = [
            f"{self.nominal.joint_names[j]} in {n} by up to {beyond[:, j].max() / units[j]:.1f} "
            f"{'mm' if slides[j] else 'degrees'}"
            for j, n in enumerate((beyond > 0.0).sum(axis=0))
            if n
        ]
        return (
            f"{count} of {len(q)} {noun} lie outside the joint ranges of the calibration's fit ({', '.join(ranges)}): "
            "the calibration is extrapolated there, and errors can be far larger."
        )

    def open_ends(self) -> float:
        """Size of what reflectors of unknown place leave open of base and tip link, metres; zero where all is known.

        Errors of the last link move flange and reflectors alike, those of the first the base. Measurements do not show
        them, so they count as large as those of the links between.
        """
        pairs = zip(self.terms, self.coefficients, strict=True)
        shifts = [value for term, value in pairs if term.family == "geometry" and term.axis[0] == "t"]
        return float(np.sqrt(3.0 * np.mean(np.square(shifts)))) if self.fitted_targets and shifts else 0.0

    def open_ends_in_words(self) -> str:
        """The same as a sentence: what it means and how to mend it; empty where nothing is left open."""
        if not self.fitted_targets:
            return ""
        return (
            f"Base and flange frames are uncertain by about {self.open_ends() / MM:.2f} mm (taken as large as the "
            "errors of the links), for the places of the reflectors on the flange are not known. Frames by irbcal cell "
            "are right with this calibration; frames from CAD or a tracker are off by as much. Where you use these, "
            "calibrate with known places (--targets)."
        )

    # ---------------------------------------------------------------- predictions

    def left_out(self, target: str | None, in_order: bool = False) -> float | None:
        """Root mean square length of residuals of poses left out of the fit, of a target or (None, or unknown) of all.

        Metres; of contiguous blocks of poses with ``in_order``. None where that is not known, or not determined.
        """
        errors = self.limits.leave_fifths_out_mm if in_order else self.limits.leave_one_out_mm
        error = errors.get(target or "", errors.get(""))
        return None if error is None else error * MM

    def determined_left_out(self, target: str | None, in_order: bool = False) -> float:
        """As `left_out`.

        Raises
        ------
        RobotError
            If it is not known, or not determined.
        """
        loo = self.left_out(target, in_order)
        if loo is None:
            left_out = "a fifth of its poses" if in_order else "a pose"
            raise RobotError(
                f"this calibration can give no intervals: without {left_out} it does not determine where "
                f"{target or 'the tip'} is; measure more poses, each target in several"
            )
        return loo

    def spread(
        self, path: chain.Walk, p: FloatArray, motion: Motion, has_move: BoolArray, target: str | None
    ) -> FloatArray:
        """Covariance of points of the tool, one a pose, from that of the parameters.

        Parameters
        ----------
        path : Walk
            The calibrated arm at the motion.
        p : ndarray, shape (3, n)
            In the base link, metres.
        motion : Motion
        has_move : ndarray of bool, shape (n,)
            Where the last move is known.
        target : str or None
            The reflector; None for points of the tip in the base link, which neither base nor targets move.

        Returns
        -------
        ndarray, shape (n, 3, 3)
            In the base link, m^2.
        """
        J = self.jacobian(path, p, motion, has_move, target)
        CJ = (self.covariance @ J.reshape(len(J), -1)).reshape(J.shape)
        spread = CJ.transpose(2, 1, 0) @ J.transpose(2, 0, 1)
        if not has_move.all():
            H = self.from_unknown_sides(J[..., ~has_move])
            spread[~has_move] += np.einsum("kin,kjn->nij", H, H)
        return spread

    def from_unknown_sides(self, J: FloatArray) -> FloatArray:
        """What joints from an unknown side move points by, shape (terms of the last move, 3, n), of `jacobian`'s."""
        history = np.flatnonzero(bounded_history(self.terms))
        return np.asarray(J[len(J) - len(self.terms) + history] * self.coefficients[history, None, None])

    def jacobian(
        self, path: chain.Walk, p: FloatArray, motion: Motion, has_move: BoolArray, target: str | None
    ) -> FloatArray:
        """Derivative of points of the tool, one a pose, by the robot's parameters; arguments as for `spread`.

        Returns
        -------
        ndarray, shape (columns, 3, n)
            In the order of the covariance's columns, SI units.
        """
        n, nuisance = len(motion), len(self.covariance) - len(self.terms)
        J = np.zeros((len(self.covariance), 3, n))
        if target is not None:
            J[:6] = frames.by_motion(p.T).reshape(n, 3, 6).transpose(2, 1, 0)
            if target in self.fitted_targets:
                slot = 6 + 3 * self.fitted_targets.index(target)
                J[slot : slot + 3] = path.tip[:3]

        def values() -> FloatArray:
            out = self._term_model.values(motion, self.gravity)
            history = bounded_history([self.terms[k] for k in self._term_model.moving])
            out[np.ix_(history, ~has_move)] = 1.0
            return out

        self._term_model.columns(path, values, p, out=J[nuisance:])
        return J

    def predict(
        self,
        walk: Callable[[Motion], chain.Walk],
        motion: Motion,
        previous: ArrayLike | None,
        point: FloatArray,
        target: str | None,
        T_world_base: FloatArray,
        in_order: bool = False,
    ) -> Prediction:
        """Places of a point of the tool, with what is known of them; see `irbcal.modeling.robot.Robot.predict`.

        Parameters
        ----------
        walk : callable
            From a motion to the calibrated arm there.
        motion : Motion
            See `irbcal.modeling.joint_map.JointMap.motion`.
        previous : array_like, shape (n, joints), optional
            The stop before each; rows with NaN are not known, and their moves zero in the motion.
        point : ndarray, shape (3,)
            In the tip link, metres.
        target : str or None
            Which reflector it is; None for a point of the tip, which is predicted in the base link.
        T_world_base : ndarray, shape (4, 4)
        in_order : bool
            Take the residuals of contiguous blocks of poses in place of single ones.

        Raises
        ------
        RobotError
            If leave-one-out residuals are not known or not determined.
        """
        loo = self.determined_left_out(target, in_order)
        position, covariance, outside = self.positions(walk, motion, previous, point, target, T_world_base)
        variance = np.diagonal(covariance, axis1=1, axis2=2)
        return Prediction(position, covariance, NORMAL_95 * np.sqrt(np.maximum(variance, 0.0) + loo**2 / 3.0), outside)

    def positions(
        self,
        walk: Callable[[Motion], chain.Walk],
        motion: Motion,
        previous: ArrayLike | None,
        point: FloatArray,
        target: str | None,
        T_world_base: FloatArray,
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Positions (n, 3), their covariance (n, 3, 3) and which poses are outside; parameters as `predict`."""
        has_move = known_moves(motion, previous)
        T = np.eye(4) if target is None else T_world_base
        R = T[:3, :3]
        position, covariance = np.empty((len(motion), 3)), np.empty((len(motion), 3, 3))
        for start in range(0, len(motion), BLOCK):
            rows = slice(start, start + BLOCK)
            block = motion.select(rows)
            path = walk(block)
            p = path.tip[3] + np.einsum("acn,a->cn", path.tip[:3], point)
            position[rows] = p.T @ R.T + T[:3, 3]
            covariance[rows] = R @ self.spread(path, p, block, has_move[rows], target) @ R.T
        return position, covariance, self.outside(motion.q)

    def moves(
        self,
        walk: Callable[[Motion], chain.Walk],
        motion: Motion,
        previous: ArrayLike | None,
        point: FloatArray,
        target: str,
    ) -> tuple[FloatArray, FloatArray]:
        """Lengths of the ways from each place to the next, and half-widths, shape (n - 1,); parameters as `predict`."""
        loo = self.determined_left_out(target)
        has_move = known_moves(motion, previous)
        count = max(len(motion) - 1, 0)
        length, variance = np.zeros(count), np.zeros(count)
        for start in range(0, count, BLOCK):
            rows = slice(start, start + BLOCK + 1)
            block, known = motion.select(rows), has_move[rows]
            path = walk(block)
            p = path.tip[3] + np.einsum("acn,a->cn", path.tip[:3], point)
            J, way = self.jacobian(path, p, block, known, target), np.diff(p, axis=1)
            each = np.linalg.norm(way, axis=0)
            u = way / np.where(each > 0.0, each, 1.0)
            g = np.einsum("ckm,km->cm", np.diff(J, axis=2), u)
            spread = np.einsum("cm,cm->m", g, self.covariance @ g)
            sides = self.from_unknown_sides(J)
            for end in (slice(None, -1), slice(1, None)):
                spread += np.sum(np.einsum("hkm,km->hm", sides[..., end], u) ** 2, axis=0) * ~known[end]
            length[start : start + BLOCK], variance[start : start + BLOCK] = each, spread
        return length, NORMAL_95 * np.sqrt(np.maximum(variance, 0.0) + 2.0 * loo**2 / 3.0)


def known_moves(motion: Motion, previous: ArrayLike | None) -> BoolArray:
    """At which stops the one before is known, shape (n,)."""
    if previous is None:
        return np.zeros(len(motion), dtype=bool)
    return np.asarray(np.isfinite(motion.q - np.asarray(previous, dtype=float)).all(axis=1))
