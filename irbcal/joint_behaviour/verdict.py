"""What the joints of a robot do, in sentences, and which non-geometric terms it needs.

One-joint moves and residuals look at a joint in different ways: where there are both, each sentence says which it is
from, and what the two do not agree on is said, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from irbcal.joint_behaviour.terms import SIGNIFICANT, WORTH, Slides, Term, fourier_order, unit_of
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray
    from irbcal.joint_behaviour.behaviour import JointBehaviour
    from irbcal.joint_behaviour.moves import JointMoves
    from irbcal.joint_behaviour.residuals import ResidualAnalysis
    from irbcal.modeling.stiffness import Stiffness

LABELS = {"worth it": "worth it", "small": "real, but hardly worth it", "not seen": "not worth it"}
LEFT_OUT = "left-out rms"
MOSTLY = 0.8
"""Share of the squares that a Fourier series explains from which on gravity, which explains so much, has its place."""
BESIDE = "the other terms that this robot needs"


def verdict(found: JointBehaviour) -> list[str]:
    """Which non-geometric terms this robot needs, in sentences.

    Nubiola 2011, section 7.2: an analysis of each axis tells whether a stiffness model and a model of joint 6 are
    necessary.

    Parameters
    ----------
    found : JointBehaviour

    Returns
    -------
    list of str
    """
    residuals = found.residuals
    out = of_moves(found.moves, alone=residuals is None)
    if residuals is None:
        return out
    sentences = of_residuals(residuals, found.stiffness_geometry)
    return [*out, *sentences[:-1], *_disagreements(found.moves, residuals), sentences[-1]]


def of_moves(moves: Sequence[JointMoves], alone: bool = True) -> list[str]:
    """What one-joint moves say; ``alone``: nothing else is said, so the last sentence is what the robot needs."""
    source = "" if alone else "by one-joint moves, "
    out = [f"{source}{_of_moves(joint, term)}" for joint in moves for term in joint.terms if _worth_saying(term)]
    out += _beyond([joint.backlash for joint in moves])
    out += _not_tested([term for joint in moves for term in joint.terms], "one-joint moves")
    if moves and alone:
        out += _period_of_weight(moves)
        out.append(_needed_by_moves(moves))
    return out


def _disagreements(moves: Sequence[JointMoves], residuals: ResidualAnalysis) -> list[str]:
    """Terms that one of the two sources calls worth having and the other does not."""
    needed = {(step.kind, step.joint) for step in residuals.needed}
    tested = {(term.kind, term.joint) for term in residuals.terms if term.tested}
    best = [term for joint in moves for term in _best(joint)]
    out = []
    for term in (term for joint in moves for term in joint.terms if term.tested):
        key = (term.kind, term.joint)
        name = f"{name_of(term)}{_joints([term.joint])}"
        if key in needed and term.verdict != "worth it":
            out.append(
                f"{name}: needed by the residuals, {LABELS[term.verdict]} by the one-joint moves: these stand at one "
                "home pose, the residuals at all poses"
            )
        elif key in tested - needed and term in best:
            out.append(
                f"{name}: worth it by the one-joint moves, not needed by the residuals: it may be small beside their "
                "other errors, or hold at that home pose only"
            )
    return out


def _worth_saying(term: Term) -> bool:
    return term.tested and (term.kind not in ("gain", "move") or term.verdict in ("worth it", "small"))


def _not_tested(terms: Sequence[Term], source: str) -> list[str]:
    """One sentence for each reason, with its joints."""
    reasons: dict[tuple[str, str], list[int | None]] = {}
    for term in terms:
        if term.note and term.kind not in ("gain", "move"):
            reasons.setdefault((name_of(term), term.note), []).append(term.joint)
    return [f"{name}{_joints(joints)} not tested by {source}: {note}" for (name, note), joints in reasons.items()]


def _joints(joints: Sequence[int | None]) -> str:
    if list(joints) == [None]:
        return ""
    numbers = [str(joint) for joint in joints]
    if len(numbers) == 1:
        return f" of joint {numbers[0]}"
    return f" of joints {', '.join(numbers[:-1])} and {numbers[-1]}"


def _p(p: float) -> str:
    return "p < 0.001" if p < 1e-3 else f"p = {p:.2g}"


def _plus_minus(value: float, low: float, high: float, size: float, digits: int = 4) -> str:
    return f"{value / size:.{digits}f} ± {(high - low) / 2 / size:.{digits}f}"


def _change(term: Term, what: str) -> str:
    return f"reduces the {what} from {term.rms_without / MM:.3f} to {term.rms_with / MM:.3f} mm"


def _judgement(term: Term, what: str, beside: str = "") -> str:
    if term.verdict == "not seen" and term.rms_with >= term.rms_without:
        return f"does not reduce the {what} ({_p(term.p)}): not worth it"
    return f"{_change(term, what)}{beside} (F test, {_p(term.p)}): {LABELS[term.verdict]}"


def name_of(term: Term) -> str:
    """A term in words."""
    if term.kind == "fourier":
        return f"Fourier series of order {fourier_order(term)}{_frequency(term)}"
    names = {"backlash": "backlash", "gain": "gain error", "gravity": "bending under gravity"}
    return names.get(term.kind, "arm stiffness")


def _frequency(term: Term) -> str:
    if not term.frequency or term.frequency == (1.0,):
        return ""
    if len(term.frequency) == 1:
        return f" at {term.frequency[0]:.4g} periods per turn"
    found, low, high = term.frequency
    return f" at {found:.4g} ({low:.4g} to {high:.4g}) periods per turn (free)"


def _play_in_words(term: Term, slides: Slides = ()) -> str:
    unit, size = unit_of(term, slides)
    unit = {"deg": "degrees"}.get(unit, unit)
    amount = _plus_minus(term.values[0], term.low[0], term.high[0], size)
    if term.verdict == "not seen":
        return f"joint {term.joint}: no backlash seen ({amount} {unit}, {_p(term.p)})"
    return f"backlash joint {term.joint}: {amount} {unit} ({_p(term.p)})"


def _of_moves(joint: JointMoves, term: Term) -> str:
    what = "tangential rms"
    if term.kind == "backlash":
        said = _play_in_words(term)
        return said if term.verdict == "not seen" else f"{said}: {_change(term, what)}: {LABELS[term.verdict]}"
    said = f"joint {joint.joint}: {name_of(term)} {_judgement(term, what)}"
    arc = max(np.ptp(series.turn) for series in joint.series)
    if term.kind == "fourier" and term.verdict == "worth it" and arc < np.pi:
        said += f"; on an arc of {arc / DEG:.0f} degrees its coefficients hold there only"
    if term.kind == "gravity" and term.verdict == "worth it":
        said += "; model 34 has it as arm stiffness, joints with --robot estimates A and B"
    return said


def _beyond(terms: Sequence[Term]) -> list[str]:
    """Joints that do the contrary of what play does."""
    joints = [term.joint for term in terms if term.seen and term.values[0] < 0]
    if not joints:
        return []
    return [
        f"negative backlash{_joints(joints)}: the joint stands BEYOND its reading in the direction it came from; play "
        "would hold it back"
    ]


def _best(joint: JointMoves) -> list[Term]:
    """Backlash, and of gain, series and gravity, which explain much of the same, the one that leaves least."""
    worth = [term for term in joint.terms if term.verdict == "worth it"]
    runs = sorted((term for term in worth if term.kind != "backlash"), key=lambda term: term.rms_with)
    weight = [term for term in runs if term.kind == "gravity"]
    if weight and runs[0].kind == "fourier":  # the series has gravity's one period a turn, too: whose is it?
        rest = runs[0].rms_without ** 2 - runs[0].rms_with ** 2
        if runs[0].rms_without ** 2 - weight[0].rms_with ** 2 > MOSTLY * rest:
            runs = weight
    return [term for term in worth if term.kind == "backlash"] + runs[:1]


def _period_of_weight(moves: Sequence[JointMoves]) -> list[str]:
    """Joints whose needed gain or series may be weight, which has one period a turn: one home pose cannot tell."""
    joints = [
        joint.joint
        for joint in moves
        for term in _best(joint)
        if len(joint.series) == 1 and (term.kind == "gain" or (term.kind == "fourier" and term.frequency == (1.0,)))
    ]
    if not joints:
        return []
    return [
        f"what gain error or Fourier series{_joints(joints)} explain may be bending under weight, which has one period "
        "a turn: moves from one home pose cannot tell these apart; poses all over the workspace can (--robot)"
    ]


def _needed_by_moves(moves: Sequence[JointMoves]) -> str:
    terms = [term for joint in moves for term in joint.terms]
    names = [f"{name_of(term)} of joint {term.joint}" for joint in moves for term in _best(joint)]
    if names:
        return f"This robot needs: {', '.join(names)}."
    if not any(term.tested for term in terms if term.kind != "gain"):
        return "What this robot needs is not known: these moves test neither backlash nor Fourier series."
    return "This robot needs none of the terms that could be tested."


def of_residuals(found: ResidualAnalysis, geometry: tuple[Sequence[float] | FloatArray, Stiffness] | None) -> list[str]:
    """What the residuals say; the last sentence is what the robot needs."""
    slides = found.robot.arm.table.prismatic
    hidden = any(term.beside_needed is not None for term in found.terms)
    out = [
        f"the {LEFT_OUT} is that of poses left out of the fit one at a time; each term is tested beside geometry, the "
        "model's own terms and, where they count, the last moves; what several terms explain is counted once only in "
        f"the last line{'; what was hidden so is given beside ' + BESIDE if hidden else ''}"
    ]
    for tested in found.terms:
        term = tested.shown
        beside = "" if tested.beside_needed is None else f" beside {BESIDE}"
        if term.kind == "backlash" and term.tested:
            said = _play_in_words(term, slides)
            out.append(f"{said}: {_change(term, LEFT_OUT)}{beside}: {LABELS[term.verdict]}" if term.seen else said)
        elif term.kind == "move" and term.seen:
            amount = _plus_minus(term.values[0], term.low[0], term.high[0], 0.01)
            out.append(
                f"joint {term.joint}:{beside or ' beside its direction'}, the size of the last move counts: {amount} "
                f"degrees per 100 degrees moved ({_p(term.p)}): {LABELS[term.verdict]}"
            )
        elif term.kind == "stiffness" and term.tested:
            out.append(f"{_stiffness_in_words(term, geometry)} {_judgement(term, LEFT_OUT, beside)}")
        elif term.verdict == "worth it":
            out.append(f"joint {term.joint}: {name_of(term)} {_judgement(term, LEFT_OUT, beside)}")
    return [
        *out,
        *_not_worth(found),
        *_not_tested(found.terms, "the residuals"),
        *_of_approach(found),
        needed_by_residuals(found),
    ]


def _not_worth(found: ResidualAnalysis) -> list[str]:
    """One sentence for each kind of gains and series that are real but small, or not seen."""
    by_kind: dict[tuple[str, str], list[int | None]] = {}
    for term in (term.shown for term in found.terms):
        if term.kind in ("gain", "fourier") and term.verdict in ("small", "not seen"):
            name = "gain error" if term.kind == "gain" else "Fourier series"
            by_kind.setdefault((name, term.verdict), []).append(term.joint)
    return [f"{name}{_joints(joints)}: {LABELS[what]}" for (name, what), joints in by_kind.items()]


def _stiffness_in_words(term: Term, geometry: tuple[Sequence[float] | FloatArray, Stiffness] | None) -> str:
    values = dict(zip(term.names, zip(term.values, term.low, term.high, strict=True), strict=True))
    said = ", ".join(f"{name} = {_plus_minus(*value, DEG)} degrees" for name, value in values.items())
    held = geometry[1].with_coefficients(*term.values) if geometry and len(values) == 2 else None
    if held is not None:
        said += f"; the stretched arm bends by {held.delta_L / MM:.2f} mm"
    return f"arm stiffness ({said})"


def _of_approach(found: ResidualAnalysis) -> list[str]:
    """What the direction and the size of the last move explain together, and whether it looks like play."""
    approach = found.approach
    if not np.isfinite(approach["direction"]):
        return []
    play = [term.shown for term in found.of("backlash").values() if term.shown.seen]
    if not play:
        return []
    out = [
        f"directions of approach of all joints together reduce the {LEFT_OUT} from {approach['neither'] / MM:.3f} to "
        f"{approach['direction'] / MM:.3f} mm",
        *_beyond(play),
    ]
    differ = [t.joint for t in play if t.joint and found.halves_p[t.joint - 1] < SIGNIFICANT / len(play)]
    if differ:
        which = ", ".join(map(str, differ))
        out.append(f"the first and the second half of the poses disagree on the backlash of joint {which}")
    else:
        out.append(
            "the first and the second half of the poses, taken by themselves, agree on it within their uncertainty"
        )
    if approach["size"] < (1 - WORTH) * approach["direction"]:
        out.append(
            f"the SIZES of the last moves explain more ({approach['size'] / MM:.3f} mm) than their directions: play in "
            "gears does not grow with the move; a lag does, or joints that were read before the robot stood still"
        )
    return out


def needed_by_residuals(found: ResidualAnalysis) -> str:
    """The terms that the robot needs, in one sentence."""
    if not found.needed:
        return f"This robot needs no term beyond geometry ({found.rms_geometry / MM:.3f} mm {LEFT_OUT})."
    names = {
        "backlash": "backlash of joint {}",
        "move": "error by the size of the last move of joint {}",
        "gain": "gain of joint {}",
        "fourier": "Fourier series of joint {}",
        "stiffness": "arm stiffness",
    }
    steps = ", ".join(f"{names[s.kind].format(s.joint)} ({s.rms / MM:.3f})" for s in found.needed)
    return (
        f"This robot needs, the most important first: {steps}; in brackets the {LEFT_OUT} in mm with all terms so far, "
        f"geometry alone {found.rms_geometry / MM:.3f}."
    )
