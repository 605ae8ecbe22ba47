r"""Behaviour of each joint: what it does beyond geometry (Nubiola 2011, chapter 4 and sections 5.2 and 5.3).

Two ways of looking at a joint:

- one-joint moves (`irbcal.joint_behaviour.moves`): groups ``axis1``, ``axis2``, ...; several tests of one joint may
  be called ``axis6_b``, ``axis6_c``. Circles alone give the axis; radial, axial and tangential errors of every point
  and the angular error of every pose follow without a robot model;
- residuals of a robot model (`irbcal.joint_behaviour.residuals`): any poses. Effects of a joint are estimated by
  least squares through the analytic Jacobian, with base, targets and link geometry refitted at the same time.

Backlash is the joint's angle reached from above minus the angle reached from below, for one command: twice the
half-width, positive where the joint stops short of where it was sent. Intervals are 95 %: of one-joint moves from the
least-squares covariance (with that of the circles), of residuals from leaving out one pose at a time (jackknife). p
values are those of the F test with these covariances, within one kind of term corrected for the number of joints
tested (Holm) and for the number of frequencies tried.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from irbcal.errors import IdentificationError, MeasurementError, RobotError
from irbcal.identification import outliers
from irbcal.joint_behaviour.moves import analyse_moves, has_moves, one_series
from irbcal.joint_behaviour.residuals import ResidualAnalysis, analyse_residuals
from irbcal.joint_behaviour.terms import SIGNIFICANT, WORTH
from irbcal.measurement.last_moves import last_moves
from irbcal.modeling import parameters
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.units import DEG, MM

# --- stiffness as one angle ------------------------------------------------------------------------------


def equivalent_error(q2, q3, stiffness, phases, lengths):
    """Angle of joint 2 that moves the wrist as both joints' bending does, zero at q2 = 0 (Nubiola 2011, section 5.3).

    Parameters
    ----------
    q2 : ndarray, shape (n,)
        Radians.
    q3 : float
        Radians.
    stiffness : array_like, shape (2,)
        A and B, radians.
    phases : array_like, shape (2,)
        Of upper arm and forearm, see `irbcal.modeling.joint_map`.
    lengths : array_like, shape (2,)
        Of upper arm and forearm, metres.

    Returns
    -------
    ndarray, shape (n,)
        Radians. With both links in line it is eq. 5.17.
    """
    (A, B), (L_1, L_2), (phi_2, phi_3) = stiffness, lengths, phases
    bend = q3 + phi_3 - phi_2
    across = L_2**2 + L_1 * L_2 * np.cos(bend)
    share = across / (L_1**2 + L_2**2 + 2 * L_1 * L_2 * np.cos(bend))

    def at(angle):
        upper, fore = A * np.sin(angle + phi_2), B * np.sin(angle + q3 + phi_3)
        return upper + fore * (1 + share)

    return at(np.asarray(q2, dtype=float)) - at(0.0)


def predicted_series(series, robot, stiffness):
    """The angular errors that stiffness alone would show in a series of one-joint moves.

    The same points are computed with and without it and evaluated like measured ones, so that what the circles take of
    the bending is taken here, too.

    Parameters
    ----------
    series : Series
    robot : Robot
    stiffness : array_like, shape (2,)

    Returns
    -------
    ndarray, shape (n,)
        Radians, zero where the measured ones are.
    """
    points = series.points
    phases = robot.joint_map.phases
    bent = robot.replace(joint_map=JointMap(np.zeros(points.q.shape[1]), stiffness, phases))
    modelled = replace(points, xyz=points.predicted(bent))
    return one_series(modelled, np.full(points.poses, np.nan), series.joint, series.name).angle


# --- from a file to the whole answer ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Report:
    """What `irbcal axes` says.

    Attributes
    ----------
    source : str
    simulated : bool
    moves : list of JointMoves
        Empty where there are no one-joint moves.
    residuals : ResidualAnalysis or None
        None without a robot.
    excluded : list of dict
        ``pose``, ``target``, ``reason``.
    notes : list of str
    stiffness_geometry : tuple or None
        Phases and physical guess of the nominal arm, see `irbcal.modeling.arm.Arm.stiffness_geometry`; None where the
        stiffness model is not for this arm.
    """

    source: str
    simulated: bool
    moves: list
    residuals: ResidualAnalysis | None
    excluded: list
    notes: list
    stiffness_geometry: tuple | None = None


def analyse(
    measurements, robot=None, nominal=None, references=None, joint=None, order=2, frequency=1.0, simulated=False
):
    """Both analyses of a measurement file, as far as it allows.

    Parameters
    ----------
    measurements : MeasurementSet
    robot : Robot or Arm, optional
        A robot with its targets (from a calibration), or a nominal arm, which is identified from these points with the
        level for that kind of arm. Without: circles alone.
    nominal : Arm, optional
        Nominal arm of a calibrated robot: its lengths name the stretched arm's bending.
    references : dict of str to ndarray, optional
        Reference places of the calibration, metres.
    joint, order, frequency
        See `analyse_moves`.
    simulated : bool
        Whether the robot comes from simulated data.

    Returns
    -------
    Report

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    from irbcal.measurement import cleaning

    table = measurements.table
    pose_names = table.groupby("pose_index", sort=True)["pose"].first().to_numpy(dtype=object)
    numbered = replace(measurements, table=table.assign(pose=table["pose_index"].astype(str)))
    known = robot.targets if isinstance(robot, Robot) else None
    cleaned = cleaning.clean(numbered, references, known)
    points = cleaned.points
    step = last_moves(measurements.joints(), _groups(table))[points.pose_ids.astype(int)]
    points = replace(points, pose_ids=pose_names[points.pose_ids.astype(int)])
    excluded = [
        {"pose": str(pose_names[int(item.pose)]), "target": item.target, "reason": item.reason}
        for item in cleaned.excluded
    ]
    moves = []
    notes = list(cleaned.notes)
    if has_moves(points):
        try:
            moves = _named(measurements.source, analyse_moves, points, step, joint, order, frequency)
        except IdentificationError as error:
            if robot is None:
                raise
            notes.append(f"The one-joint moves are not analysed by themselves: {error}")
        excluded += [
            _far(item, "its circle") for joint_moves in moves for s in joint_moves.series for item in s.excluded
        ]
    elif robot is None:
        raise MeasurementError(
            f"{measurements.source}: there are no one-joint moves (column group: axis1, axis2, …); for other poses a "
            "robot or a calibration is needed"
        )
    residuals = None
    nominal = robot if isinstance(robot, Arm) else nominal
    if robot is not None:
        robot = robot if isinstance(robot, Robot) else _named(measurements.source, _identified, robot, points)
        residuals = _named(measurements.source, analyse_residuals, robot, points, step, joint, order, frequency)
        excluded += [_far(item, "the robot") for item in residuals.excluded]
    is_simulated = measurements.simulated or simulated
    geometry = None
    if nominal is not None:
        with suppress(RobotError):
            geometry = nominal.stiffness_geometry()
    return Report(measurements.source, is_simulated, moves, residuals, excluded, notes, geometry)


def _groups(table):
    if "group" not in table.columns:
        return None
    return table.groupby("pose_index", sort=True)["group"].first().to_numpy(dtype=object)


def _far(item, where):
    pose, target, off = item
    return {"pose": pose, "target": target, "reason": f"gross error: {off / MM:.3g} mm from {where}"}


def _named(source, function, *arguments):
    """Refusals with the file's name."""
    try:
        return function(*arguments)
    except IdentificationError as error:
        raise IdentificationError(f"{source}: {error}") from None


def _identified(arm, points):
    from irbcal.identification.fit import identify

    keep, _ = outliers.find_gross_errors(arm, points)
    used = points.take(keep).without_empty_poses().with_seen_targets()
    return identify(arm, used, parameters.default_level(arm)).robot


# --- numbers for others ----------------------------------------------------------------------------------


def as_dict(report):
    """The report as plain numbers and words: lengths in mm, angles in degrees.

    Parameters
    ----------
    report : Report

    Returns
    -------
    dict
        ``source``, ``simulated``, ``moves`` (by joint: series with errors, terms), ``residuals`` (terms, halves,
        approach, needed; None without a robot), ``verdict`` (sentences), ``excluded``, ``notes``.
    """
    residuals = report.residuals
    return {
        "source": report.source,
        "simulated": report.simulated,
        "moves": [_moves_dict(joint) for joint in report.moves],
        "residuals": None if residuals is None else _residuals_dict(residuals),
        "verdict": verdict(report),
        "excluded": report.excluded,
        "notes": report.notes,
    }


def error_size(values):
    """Root mean square and largest size of errors in metres, in mm."""
    values = np.asarray(values) / MM
    return {"rms_mm": float(np.sqrt(np.mean(values**2))), "max_mm": float(np.abs(values).max())}


def _moves_dict(joint):
    series = [
        {
            "group": s.name,
            "poses": len(s.q),
            "from_both_sides": bool({-1.0, 1.0} <= set(s.direction)),
            "home_deg": [None if k == s.joint - 1 else float(v / DEG) for k, v in enumerate(s.q[0])],
            "range_deg": [float(s.turn.min() / DEG), float(s.turn.max() / DEG)],
            "radius_mm": {
                s.points.target_names[t]: float(r / MM) for t, r in zip(s.fit.targets, s.fit.radii, strict=True)
            },
            "radial": error_size(s.radial),
            "tangential": error_size(s.tangential),
            "axial": error_size(s.axial),
            "angle_peak_to_peak_deg": float(np.ptp(s.angle) / DEG),
            "zero_deg": s.zero / DEG,
        }
        for s in joint.series
    ]
    return {"joint": joint.joint, "series": series, "terms": [term_dict(term) for term in joint.terms]}


def _residuals_dict(found):
    slides = found.robot.arm.table.prismatic
    halves = [
        {
            "joint": j + 1,
            "first": _outside(found.halves[j, 0], slides[j]),
            "second": _outside(found.halves[j, 1], slides[j]),
            "p": _number(found.halves_p[j]),
        }
        for j in range(len(slides))
    ]
    return {
        "robot": found.robot.arm.name,
        "poses": found.points.poses,
        "points": len(found.points),
        "rms_mm": found.rms / MM,
        "terms": [term_dict(term, slides) for term in found.terms],
        "backlash_halves": halves,
        "left_out_rms_by_approach_mm": {name: _number(value / MM) for name, value in found.approach.items()},
        "left_out_rms_geometry_mm": found.rms_geometry / MM,
        "needed": [
            {"kind": step.kind, "joint": step.joint, "p": step.p, "left_out_rms_mm": step.rms / MM}
            for step in found.needed
        ],
    }


def unit_of(term, slides=()):
    """Unit of a term's values outside, and its SI value."""
    if term.kind == "gain":
        return "1", 1.0
    if term.kind == "move":
        return "deg/100 deg", 0.01
    if term.joint is not None and len(slides) and slides[term.joint - 1]:
        return "mm", MM
    return "deg", DEG


def term_dict(term, slides=()):
    """One term as plain numbers; values in degrees, millimetres, degrees per 100 degrees, or none."""
    unit, size = unit_of(term, slides)
    values = {
        name: {"value": value / size, "low": low / size, "high": high / size}
        for name, value, low, high in zip(term.names, term.values, term.low, term.high)  # noqa: B905
    }
    frequency = None if term.frequency is None or term.note else [float(f) for f in term.frequency]
    return {
        "kind": term.kind,
        "joint": term.joint,
        "unit": unit,
        "values": values,
        "p": None if term.note else term.p,
        "rms_without_mm": _number(term.rms_without / MM),
        "rms_with_mm": _number(term.rms_with / MM),
        "at_tool_mm": _number(term.at_tool / MM),
        "verdict": term.verdict,
        "frequency": frequency,
        "note": term.note,
    }


def _number(value):
    return float(value) if np.isfinite(value) else None


def _outside(value, slides):
    return _number(value / (MM if slides else DEG))


# --- words -----------------------------------------------------------------------------------------------


def verdict(report):
    """Which non-geometric terms this robot needs, in sentences.

    Parameters
    ----------
    report : Report

    Returns
    -------
    list of str
    """
    out = []
    for joint in report.moves:
        out += [_of_moves(joint, term) for term in joint.terms if _worth_saying(term)]
    out += _beyond([joint.backlash for joint in report.moves])
    out += _not_tested([term for joint in report.moves for term in joint.terms], "one-joint moves")
    if report.moves and report.residuals is None:
        out.append(_needed_by_moves(report.moves))
    if report.residuals is not None:
        out += _of_residuals(report.residuals, report.stiffness_geometry)
    return out


def _worth_saying(term):
    return term.tested and (term.kind not in ("gain", "move") or term.verdict in ("worth it", "small"))


def _not_tested(terms, source):
    """One sentence for each reason, with its joints."""
    reasons = {}
    for term in terms:
        if term.note and term.kind not in ("gain", "move"):
            reasons.setdefault((name_of(term), term.note), []).append(term.joint)
    return [f"{name}{_joints(joints)} not tested by {source}: {note}" for (name, note), joints in reasons.items()]


def _joints(joints):
    if joints == [None]:
        return ""
    numbers = [str(joint) for joint in joints]
    if len(numbers) == 1:
        return f" of joint {numbers[0]}"
    return f" of joints {', '.join(numbers[:-1])} and {numbers[-1]}"


def _p(p):
    return "p < 0.001" if p < 1e-3 else f"p = {p:.2g}"


def _plus_minus(value, low, high, size, digits=4):
    return f"{value / size:.{digits}f} ± {(high - low) / 2 / size:.{digits}f}"


def _change(term, what):
    return f"reduces the {what} from {term.rms_without / MM:.3f} to {term.rms_with / MM:.3f} mm"


LABELS = {"worth it": "worth it", "small": "real, but hardly worth it", "not seen": "not worth it"}


def _judgement(term, what):
    if term.verdict == "not seen" and term.rms_with >= term.rms_without:
        return f"does not reduce the {what} ({_p(term.p)}): not worth it"
    return f"{_change(term, what)} (F test, {_p(term.p)}): {LABELS[term.verdict]}"


def name_of(term):
    """A term in words."""
    if term.kind == "fourier":
        order = max(int(name[1:]) for name in term.names)
        return f"Fourier series of order {order}{_frequency(term)}"
    names = {"backlash": "backlash", "gain": "gain error", "gravity": "bending under gravity"}
    return names.get(term.kind, "arm stiffness")


def _frequency(term):
    if not term.frequency or term.frequency == (1.0,):
        return ""
    if len(term.frequency) == 1:
        return f" at {term.frequency[0]:.4g} periods per turn"
    found, low, high = term.frequency
    return f" at {found:.4g} ± {(high - low) / 2:.2g} periods per turn (free)"


def _play_in_words(term, slides=()):
    unit, size = unit_of(term, slides)
    unit = {"deg": "degrees"}.get(unit, unit)
    amount = _plus_minus(term.values[0], term.low[0], term.high[0], size)
    if term.verdict == "not seen":
        return f"joint {term.joint}: no backlash seen ({amount} {unit}, {_p(term.p)})"
    return f"backlash joint {term.joint}: {amount} {unit} ({_p(term.p)})"


def _of_moves(joint, term):
    what = "tangential rms"
    if term.kind == "backlash":
        said = _play_in_words(term)
        return said if term.verdict == "not seen" else f"{said}: {_change(term, what)}: {LABELS[term.verdict]}"
    said = f"joint {joint.joint}: {name_of(term)} {_judgement(term, what)}"
    arc = max(np.ptp(series.turn) for series in joint.series)
    if term.kind == "fourier" and term.verdict == "worth it" and arc < np.pi:
        said += f"; on an arc of {arc / DEG:.0f} degrees its coefficients hold there only"
    if term.kind == "gravity" and term.verdict == "worth it":
        said += "; model 34 has it as arm stiffness, axes with --robot estimates A and B"
    return said


def _beyond(terms):
    """Joints that do the contrary of what play does."""
    joints = [term.joint for term in terms if term.verdict in ("worth it", "small") and term.values[0] < 0]
    if not joints:
        return []
    return [
        f"negative backlash{_joints(joints)}: the joint stands BEYOND its reading in the direction it came from; play "
        "would hold it back"
    ]


def _best(joint):
    """Backlash, and of gain, series and gravity, which explain much of the same, the one that leaves least."""
    worth = [term for term in joint.terms if term.verdict == "worth it"]
    runs = sorted((term for term in worth if term.kind != "backlash"), key=lambda term: term.rms_with)
    return [term for term in worth if term.kind == "backlash"] + runs[:1]


def _needed_by_moves(moves):
    terms = [term for joint in moves for term in joint.terms]
    names = [f"{name_of(term)} of joint {term.joint}" for joint in moves for term in _best(joint)]
    if names:
        return f"This robot needs: {', '.join(names)}."
    if not any(term.tested for term in terms if term.kind != "gain"):
        return "What this robot needs is not known: these moves test neither backlash nor Fourier series."
    return "This robot needs none of the terms that could be tested."


LEFT_OUT = "left-out rms"


def _of_residuals(found, geometry):
    slides = found.robot.arm.table.prismatic
    out = [
        f"the {LEFT_OUT} is that of poses left out of the fit one at a time; each term is tested beside geometry, the "
        "model's own terms and, where they count, the last moves; what several terms explain is counted once only in "
        "the last line"
    ]
    for term in found.terms:
        if term.kind == "backlash" and term.tested:
            said = _play_in_words(term, slides)
            seen = term.verdict != "not seen"
            out.append(f"{said}: {_change(term, LEFT_OUT)}: {LABELS[term.verdict]}" if seen else said)
        elif term.kind == "move" and term.verdict in ("worth it", "small"):
            amount = _plus_minus(term.values[0], term.low[0], term.high[0], 0.01)
            out.append(
                f"joint {term.joint}: beside its direction, the size of the last move counts: {amount} degrees per 100 "
                f"degrees moved ({_p(term.p)}): {LABELS[term.verdict]}"
            )
        elif term.kind == "stiffness" and term.tested:
            out.append(f"{_stiffness_in_words(term, geometry)} {_judgement(term, LEFT_OUT)}")
        elif term.verdict == "worth it":
            out.append(f"joint {term.joint}: {name_of(term)} {_judgement(term, LEFT_OUT)}")
    return [*out, *_not_worth(found), *_not_tested(found.terms, "the residuals"), *_of_approach(found), _needed(found)]


def _not_worth(found):
    """One sentence for each kind of gains and series that are real but small, or not seen."""
    by_kind = {}
    for term in found.terms:
        if term.kind in ("gain", "fourier") and term.verdict in ("small", "not seen"):
            name = "gain error" if term.kind == "gain" else "Fourier series"
            by_kind.setdefault((name, term.verdict), []).append(term.joint)
    return [f"{name}{_joints(joints)}: {LABELS[what]}" for (name, what), joints in by_kind.items()]


def _stiffness_in_words(term, geometry):
    values = dict(zip(term.names, zip(term.values, term.low, term.high, strict=True), strict=True))
    said = ", ".join(f"{name} = {_plus_minus(*value, DEG)} degrees" for name, value in values.items())
    held = geometry[1].with_coefficients(*term.values) if geometry and len(values) == 2 else None
    if held is not None:
        said += f"; the stretched arm bends by {held.delta_L / MM:.2f} mm"
    return f"arm stiffness ({said})"


def _of_approach(found):
    """What the direction and the size of the last move explain together, and whether it looks like play."""
    approach = found.approach
    if not np.isfinite(approach["direction"]):
        return []
    play = [term for term in found.of("backlash").values() if term.verdict in ("worth it", "small")]
    if not play:
        return []
    out = [
        f"directions of approach of all joints together reduce the {LEFT_OUT} from {approach['neither'] / MM:.3f} to "
        f"{approach['direction'] / MM:.3f} mm",
        *_beyond(play),
    ]
    differ = [term.joint for term in play if found.halves_p[term.joint - 1] < SIGNIFICANT / len(play)]
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


def _needed(found):
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
