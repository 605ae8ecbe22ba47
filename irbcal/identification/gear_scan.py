"""Scan for gears: which single high harmonic of which joint explains most of what a fit leaves, one after the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal import parallel
from irbcal.arrays import FloatArray, IntArray
from irbcal.identification.evidence_maximisation import VARIANCE_CAP, NormalEquations, Posterior, maximise_evidence
from irbcal.identification.fit_sections import GearSpectrum, GearWave
from irbcal.identification.linear_model import Linearisation
from irbcal.identification.term_sets import TermSet
from irbcal.modeling.cos_sin import cos_sin
from irbcal.modeling.terms.gear import HIGHEST, LOWEST, gear_terms
from irbcal.modeling.terms.term import revolute
from irbcal.option_values import Progress

MOST_FREQUENCIES = 12
"""Largest number of frequencies that are taken."""
NUMBER_S = 1e-9
"""Seconds that one product of a wave and a column at a pose takes."""


class WaveSums:
    """What a search for frequencies needs, summed over the rows of each pose once: axis columns against everything.

    With ``k_jn`` the derivative of pose n's rows by joint j: ``KJ[j, n] = k_jn' J_n``, ``Ky[j, n] = k_jn' y_n`` and
    ``KK[i, j, n] = k_in' k_jn``; a wave of the joint's angle then only multiplies poses.
    """

    def __init__(self, linear: Linearisation, columns: IntArray, joints: list[int]) -> None:
        self.joints, self.q = joints, linear.motion.q
        probes = [gear_terms(j, 0)[0] for j in joints]  # cos 0: the axis column itself, times the natural size
        wide = linear.extended(probes)
        start = linear.nuisance + len(linear.terms)
        n, m, k = len(self.q), len(columns), len(joints)
        self.KJ, self.Ky, self.KK = np.zeros((k, n, m)), np.zeros((k, n)), np.zeros((k, k, n))
        for block in wide.blocks(np.concatenate([columns, start + np.arange(k)])):
            J, K = block.J[:m], block.J[m:]
            first = np.flatnonzero(np.r_[True, block.pose[1:] != block.pose[:-1]])
            poses = block.pose[first]
            self.Ky[:, poses] = np.add.reduceat(K * block.y, first, axis=1)
            for i in range(k):
                self.KJ[i, poses] = np.add.reduceat(J * K[i], first, axis=1).T
                self.KK[i][:, poses] = np.add.reduceat(K * K[i], first, axis=1)

    def chi2(self, cycles: FloatArray, pairs: list[tuple[int, int]], found: Posterior) -> FloatArray:
        """By how much each frequency of each joint would explain the residuals, shape (joints, frequencies)."""
        a = found.likelihood_power / found.s2
        taken = [self._wave(*pair) for pair in pairs]

        def of_joint(k: int) -> FloatArray:
            joint = self.joints[k]
            waves = np.exp(1j * self.q[:, joint : joint + 1] * cycles)
            KJ = np.column_stack([self.KJ[k], *(self.KK[k, i][:, None] * wave for i, wave in taken)])
            b = a * ((self.Ky[k] - KJ @ found.c) @ waves)
            scores = a * (found.whiten(KJ.T) @ waves)
            power, crossed = a * self.KK[k, k].sum(), a * (self.KK[k, k] @ (waves * waves))
            cc = 0.5 * (power + crossed.real) - np.einsum("kf,kf->f", scores.real, scores.real)
            ss = 0.5 * (power - crossed.real) - np.einsum("kf,kf->f", scores.imag, scores.imag)
            cs = 0.5 * crossed.imag - np.einsum("kf,kf->f", scores.real, scores.imag)
            det = cc * ss - cs * cs
            seen = det > 1e-4 * power * power  # else the fit's own terms cover it
            value = ss * b.real**2 - 2.0 * cs * b.real * b.imag + cc * b.imag**2
            return np.where(seen, value / np.where(seen, det, 1.0), 0.0)

        products = self.KJ.size * len(cycles)
        return np.array(list(parallel.threads(of_joint, range(len(self.joints)), NUMBER_S * products)))

    def _wave(self, place: int, cycles: float) -> tuple[int, FloatArray]:
        """Cosine and sine of a frequency of the joint at a place, shape (n, 2)."""
        angle = cycles * self.q[:, self.joints[place]]
        return place, np.column_stack(cos_sin(angle))

    def extended(self, sums: NormalEquations, pairs: Sequence[tuple[int, float]]) -> NormalEquations:
        """Sums with the columns cos, sin of some frequencies (place of the joint, cycles per turn) at the end."""
        new_waves = [self._wave(*pair) for pair in pairs]
        if not new_waves:
            return sums
        cross = np.concatenate([wave.T @ self.KJ[i] for i, wave in new_waves])
        right = np.concatenate([self.Ky[i] @ wave for i, wave in new_waves])
        own = np.block([[(a.T * self.KK[i, j]) @ b for j, b in new_waves] for i, a in new_waves])
        H = np.block([[sums.H, cross.T], [cross, own]])
        return NormalEquations(H, np.concatenate([sums.g, right]), sums.yy, sums.equations)


def scan(
    linear: Linearisation,
    term_set: TermSet,
    sums: NormalEquations,
    start: tuple[Posterior, Posterior],
    progress: Progress | None = None,
    each_counts: bool = False,
) -> tuple[list[GearWave], GearSpectrum]:
    """Take the strongest frequency while it is beyond chance and the log evidence grows.

    Beyond chance: ``chi2 > 2 ln(frequencies x joints) + 4``, of the residuals of the fit, a pose counted as one vector
    as in the log evidence. Where each coordinate counts, so much is chance in one robot of seven: there it is 9.2, one
    of a hundred.

    Parameters
    ----------
    linear : Linearisation
    term_set : TermSet
        Terms of the fit whose residuals are scanned.
    sums : NormalEquations
        Of the term set's columns.
    start : (Posterior, Posterior)
        The term set's fits at the likelihood power of the evidence and at that of the fit.
    progress : callable, optional
    each_counts : bool
        Whether points of a pose err by themselves.

    Returns
    -------
    gears : list of GearWave
        In the order in which they were found, their amplitudes not known yet: zero.
    spectrum : GearSpectrum
    """
    joints = revolute(linear.problem.arm)
    cycles = np.arange(LOWEST, HIGHEST + 1)
    reduced = WaveSums(linear, term_set.columns(linear.nuisance), joints)
    limit = 2.0 * np.log(len(joints) * len(cycles)) + (9.2 if each_counts else 4.0)
    by_evidence, by_fit = start
    pairs: list[tuple[int, int]] = []
    out: list[GearWave] = []
    first: FloatArray | None = None
    group, caps, prior = term_set.group, term_set.caps, term_set.prior
    while len(out) < MOST_FREQUENCIES:
        strength = (by_evidence.likelihood_power / by_fit.likelihood_power) * reduced.chi2(
            cycles.astype(float), pairs, by_fit
        )
        first = strength.copy() if first is None else first
        for pair, c in pairs:
            strength[pair, c - LOWEST] = 0.0
        pair, column = divmod(int(strength.argmax()), strength.shape[1])
        if strength[pair, column] <= limit:
            break
        trial = [*pairs, (pair, int(cycles[column]))]
        wide = reduced.extended(sums, trial)
        group, caps = np.concatenate([group, [len(caps)] * 2]), np.append(caps, VARIANCE_CAP)
        prior = None if prior is None else prior.extended(2)
        fits = [
            maximise_evidence(
                wide,
                linear.nuisance,
                group,
                caps,
                old.likelihood_power,
                np.append(old.variances, 1.0),
                old.s2,
                prior=prior,
            )
            for old in (by_evidence, by_fit)
        ]
        gain = fits[0].log_evidence - by_evidence.log_evidence
        if gain <= 0.0:
            break
        pairs, (by_evidence, by_fit) = trial, fits
        gear = GearWave(
            joint=joints[pair] + 1,
            cycles_per_turn=int(cycles[column]),
            amplitude_deg=0.0,
            chi2=float(strength[pair, column]),
            evidence_gain=float(gain),
        )
        out.append(gear)
        if progress is not None:
            progress(f"joint {gear.joint}: {gear.cycles_per_turn} per turn (log evidence +{gain:.1f})")
    assert first is not None
    return out, GearSpectrum.from_scan(joints, LOWEST, first, float(limit))
