"""Move: where a joint stops depends on how far it came, alone and beside the others that moved with it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import Basis, Family, Term, by_own_joint, own_axis, own_unit
from irbcal.units import MM

SIZES = {"rad": 1e-4, "m": 0.03 * MM}
GAIN_SIZE = 1e-4


class ShareOfMove(Basis):
    """``D_j / max_i |D_i|``: 1 or -1 for the joint that moved most; zero without a move."""

    name, bounded_history = "share_of_move", True

    def _parts(
        self, terms: Sequence[Term], situation: Situation
    ) -> tuple[FloatArray, FloatArray, FloatArray, np.ndarray]:
        """Own move (terms, n), largest move and its sign (n,), and whose it is (n,)."""
        D = situation.motion.moves
        largest = np.abs(D).argmax(axis=1)
        top = D[np.arange(len(D)), largest]
        size = np.where(top == 0.0, np.inf, np.abs(top))
        return D.T[[t.joint for t in terms]], size, np.sign(top), largest

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """The share, -1 to 1, shape (terms, n)."""
        moved, size, _, _ = self._parts(terms, situation)
        return moved / size

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Derivative by the joints, the stop before and the joint that moved most held, shape (terms, n, joints)."""
        moved, size, sign, largest = self._parts(terms, situation)
        out = np.zeros((len(terms), *situation.motion.q.shape))
        rows = np.arange(len(size))
        for k, term in enumerate(terms):
            out[k, :, term.joint] += 1.0 / size
            out[k, rows, largest] -= moved[k] * sign / size**2
        return out

    def slope_rates(self, terms: Sequence[Term], situation: Situation, dq: FloatArray) -> FloatArray:
        """Derivative of the slopes along joint speeds (n, joints), shape (terms, n, joints)."""
        moved, size, sign, largest = self._parts(terms, situation)
        out = np.zeros((len(terms), *situation.motion.q.shape))
        rows = np.arange(len(size))
        growth = sign * dq[rows, largest]
        for k, term in enumerate(terms):
            out[k, :, term.joint] -= growth / size**2
            out[k, rows, largest] -= sign * (dq[:, term.joint] / size**2 - 2.0 * moved[k] * growth / size**3)
        return out


class OwnMove(Basis):
    """``D_j`` itself."""

    name = "move"

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """The joint's last move, shape (terms, n), radians or metres."""
        return situation.motion.moves.T[[t.joint for t in terms]]

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """One by the own joint, shape (terms, n, joints)."""
        return by_own_joint(terms, situation, 1.0)


class Move(Family):
    """Two terms a joint with one variance: the share of the move and the move itself."""

    name, of_moves, like_lag, of_type = "move", True, True, True
    bases = (ShareOfMove(), OwnMove())

    def terms(self, arm: Arm) -> list[Term]:
        """Two terms a joint."""
        out = []
        for j in range(len(arm.joint_names)):
            axis, unit, group = own_axis(arm, j), own_unit(arm, j), f"{self.name}_{j + 1}"
            out.append(Term(j, axis, "share_of_move", SIZES[unit], group, self.name, unit))
            out.append(Term(j, axis, "move", GAIN_SIZE, group, self.name, "1"))
        return out


FAMILY = Move()
