"""Features of a calibration without a tracker in a scene: their bodies at the fitted places, and rows at them.

A body is drawn where the fit found its feature; a row's error goes from the model's point to the nearest place of the
feature that agrees with the row: the ball's centre, the foot in the plane, the point a string's length away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from string import Formatter
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray, NameArray
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification import feature_problem
from irbcal.identification.feature_problem import BASE, TOOL, FeatureProblem, FeatureState, UnknownKey
from irbcal.identification.feature_sections import FeatureRow, FeaturesSection
from irbcal.identification.observations import KINDS
from irbcal.io.schema import Record
from irbcal.measurement import features as feature_files
from irbcal.measurement.features import DISTANCE, FeatureSet, Relation
from irbcal.measurement.imaging import TARGETS
from irbcal.modeling import cell_graph, frames
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import Motion
from irbcal.units import MM, UNIT_OUTSIDE
from irbcal.viewer import shapes
from irbcal.viewer.scene import Points, ShownFeature

FRAME = "frame"
"""The frame in which a device measured whole poses: rows of kind ``pose`` have no feature."""

BALL, SOCKET, FLAT, LENGTH = shapes.colours("#c98a1b", "#5b6570", "#5d8fbf", "#7a4fa3")
"""Colours of balls and anchors, of what carries them, of planes and lines, and of lengths."""


def shown_features(
    section: FeaturesSection, reach: float, T_base_world: FloatArray | None = None
) -> tuple[ShownFeature, ...]:
    """Features, known lengths and, where whole poses were measured, the frame of a calibration, in its base link.

    Parameters
    ----------
    section : FeaturesSection
    reach : float
        Scale of the robot, metres: sizes that nothing tells are parts of it.
    T_base_world : ndarray, shape (4, 4), optional
        The measuring frame.

    Returns
    -------
    tuple of ShownFeature
        What is level has no place: it stands beside the base.
    """
    out = []
    small = float(np.clip(0.008 * reach, 0.005, 0.014))
    for row in section.features:
        T = _placed(row)
        if T is None:
            continue
        size = small
        if row.kind == "sphere":
            size = abs((row.fitted | row.known)["radius"][0]) * MM
        elif TARGETS.get(row.kind) == "camera" and "squares_x" in row.imaging:
            edges = np.array([float(row.imaging[name]) for name in ("squares_x", "squares_y")])
            edges *= float(row.imaging["square_mm"]) * MM
            T = T @ frames.transform(None, np.r_[0.5 * edges, 0.0])
            size = float(edges.mean()) / 2
        elif row.kind == "angle":
            size = 0.05 * reach
            T = T @ frames.transform(None, np.array([0.0, -0.3 * reach, 0.0]))
        elif row.kind in ("plane", "gauge", "line"):
            size = float(
                np.clip(1.5 * row.spread_mm * MM, 0.05 * reach, (0.25 if row.kind == "plane" else 0.5) * reach)
            )
        out.append(ShownFeature(row.name, row.kind, f"{row.name} · {KINDS[row.kind].shown_as or row.kind}", T, size))
    centres = {feature.name: feature.T_scene[:3, 3] for feature in out}
    for length in section.relations:
        if length.kind == DISTANCE and length.first in centres and length.second in centres:
            ends = centres[length.first], centres[length.second]
            direction = ends[1] - ends[0]
            size = float(np.linalg.norm(direction)) / 2
            T = frames.transform(frames.with_third(direction / (2 * size)) if size else None, (ends[0] + ends[1]) / 2)
            out.append(ShownFeature(length.name, DISTANCE, f"{length.known:.10g} mm", T, size))
    if "pose" in section.kinds and T_base_world is not None:
        out.append(ShownFeature("measuring frame", FRAME, "measuring frame of the poses", T_base_world, 0.08 * reach))
    return tuple(out)


def _placed(row: FeatureRow) -> FloatArray | None:
    """Where a feature stands in the base link; None where it has no place."""
    values, middle = _unknowns(row), np.array(row.middle_mm) * MM
    if "centre" in values:
        turn = values["axes"] if "axes" in row.fitted else values.get("attitude")
        return frames.transform(turn, values["centre"])
    if "line" in values:
        Q, a = values["line"][:, :3], values["line"][:, 3]
        u = Q[:, 2]
        return frames.transform(Q, a + u * (u @ (middle - a)))
    if "normal" in values and "height" in values:
        n = values["normal"][:, 2]
        foot = middle if row.kind == "gauge" else middle + n * (values["height"][0] - n @ middle)
        return frames.transform(values["normal"], foot)
    return frames.transform(values["up"]) if "up" in values else None


def _unknowns(row: FeatureRow) -> dict[str, FloatArray]:
    """What was fitted and known of a feature as its kind takes it, SI units, in the base link."""
    entries = row.known | row.fitted
    return {name: each.value(name, entries) for name, each in KINDS[row.kind].unknowns.items() if name in entries}


def bodies(features: tuple[ShownFeature, ...], reach: float) -> tuple[list[Any], list[Any]]:
    """Triangles and colours of what is solid, and of what is seen through: spheres and planes."""
    solid: list[tuple[FloatArray, FloatArray]] = []
    glass: list[tuple[FloatArray, FloatArray]] = []
    thin = 0.0018 * reach
    for feature in features:
        meshes, T, size = solid, feature.T_scene, feature.size
        if feature.kind in (DISTANCE, "line"):
            half = T[:3, 2] * size
            colour, width = (LENGTH, 0.6 * thin) if feature.kind == DISTANCE else (FLAT, thin)
            meshes.append((shapes.rod(T[:3, 3] - half, T[:3, 3] + half, width), colour))
        elif feature.kind == "sphere":
            glass.append((shapes.moved(shapes.sphere(size), T[:3, 3]), BALL))
        elif feature.kind in KINDS and KINDS[feature.kind].shown_as == "camera":  # with the way it looks
            cone = shapes.cone(0.4 * size, 1.8 * size, 0.0, 2.5 * size)
            body = shapes.box([2.4 * size, 2.4 * size, 3.0 * size]) - np.array([0.0, 0.0, 1.5 * size])
            meshes += [(mesh @ T[:3, :3].T + T[:3, 3], SOCKET) for mesh in (cone, body)]
        elif feature.kind == "plane" or TARGETS.get(feature.kind) == "camera":
            patch = shapes.box([2 * size, 2 * size, 0.6 * thin])
            glass.append((patch @ T[:3, :3].T + T[:3, 3], FLAT))
            solid.append((shapes.rod(T[:3, 3], T[:3, 3] + 0.2 * size * T[:3, 2], 0.6 * thin), FLAT))
        elif feature.kind == "angle":  # what is level, and upwards
            disc = shapes.cone(size, size, -0.3 * thin, 0.3 * thin)
            glass.append((disc @ T[:3, :3].T + T[:3, 3], FLAT))
            solid.append((shapes.rod(T[:3, 3], T[:3, 3] + size * T[:3, 2], 0.6 * thin), SOCKET))
        elif feature.kind == FRAME:
            colours = (BALL, FLAT, LENGTH)
            solid += [
                (shapes.rod(T[:3, 3], T[:3, 3] + size * T[:3, k], thin), colour) for k, colour in enumerate(colours)
            ]
        elif feature.kind == "gauge":
            meshes.append((shapes.rod(T[:3, 3] - T[:3, 2] * size, T[:3, 3], thin), SOCKET))
        else:
            meshes.append((shapes.moved(shapes.sphere(size), T[:3, 3]), BALL))
            foot = shapes.cone(1.7 * size, 1.0 * size, -1.7 * size, -0.6 * size)
            meshes.append((shapes.moved(foot, T[:3, 3]), SOCKET))
    return solid, glass


# --- rows at features -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class AtFeatures:
    """Rows at features in a scene."""

    points: Points
    """Places on the features stand for measured ones."""
    motion: Motion
    """Of the poses."""
    ids: NameArray
    groups: NameArray
    """Shape (n,)."""
    fitted: BoolArray | None
    """Shape (n,)."""
    simulated: bool
    notes: list[str]


def are_rows(record: Record, header: list[str]) -> bool:
    """Whether columns are those of rows at features of a calibration: they name one, by themselves or together."""
    if record.features is None:
        return False
    columns = {column for _, column, *_ in Formatter().parse(record.features.feature_column) if column}
    return "feature" in header or (bool(columns) and columns <= set(header))


def at_rows(record: Record, table: Any) -> AtFeatures:
    """Rows at the features of a calibration, and what both models say of them.

    The calibrated robot is held against the fitted features, the nominal one against features fitted again about it, as
    in the calibration's own figures; its error is drawn to the fitted feature.

    Raises
    ------
    MeasurementError
        If rows are at a feature or of a target that the calibration does not know.
    """
    section = record.features
    assert section is not None
    calibrated, nominal = record.robot_calibrated(), record.robot_nominal()
    features = feature_files.read(table, _known(section), nominal.arm)
    relations = tuple(
        Relation(row.name, row.kind, row.first, row.second, row.known * dict(UNIT_OUTSIDE.values())[row.unit])
        for row in section.relations
        if {row.first, row.second} <= set(features.features)
    )
    features = replace(features, relations=relations)
    _refuse_strangers(features, section, calibrated)
    fitted: dict[UnknownKey, FloatArray] = {}
    for row in section.features:
        of_target = {name for name, unknown in KINDS[row.kind].unknowns.items() if unknown.owner == "target"}
        for name, value in _unknowns(row).items():
            fitted[name, row.target if name in of_target else row.name] = value
    state = FeatureState(_tools(calibrated) | fitted, np.zeros(0))
    misses, drawn = _missed(_problem(calibrated, features), state)
    anew = _problem(nominal, features)
    try:
        begin = FeatureState(_tools(nominal), np.zeros(0))
        placed = feature_problem.start_of_features(anew, begin)
        misses_nominal = _missed(anew, placed)[0]
    except IdentificationError as error:
        raise MeasurementError(
            f"these rows do not place the features about the nominal robot: {error}", file=features.source
        ) from None
    rows = np.isfinite(misses).all(axis=1)
    if not rows.any():
        raise MeasurementError("these rows have angles only: nothing of them can be drawn", file=features.source)
    index, first, pose = np.unique(features.pose_index, return_index=True, return_inverse=True)
    names = list(calibrated.targets)
    groups = (
        features.cells["place"].astype(str).to_numpy(dtype=object)
        if "place" in features.cells.columns
        else features.feature
    )
    fitted_here = any(file.sha256 == features.sha256 for file in record.data)
    return AtFeatures(
        points=Points(
            pose[rows],
            np.array([names.index(str(name)) for name in features.target])[rows],
            drawn[rows],
            (drawn + misses)[rows],
            (drawn + misses - misses_nominal)[rows],
        ),
        motion=features.motion().select(first),
        ids=features.pose[first].astype(str),
        groups=groups[first].astype(str),
        fitted=np.ones(len(index), dtype=bool) if fitted_here else None,
        simulated=features.simulated,
        notes=[
            "Errors are distances of rows from their features, whose own places are fitted: how well the robot agrees "
            "with itself, not its accuracy in a measuring frame."
        ],
    )


def _known(section: FeaturesSection) -> pd.DataFrame:
    """The features of a calibration as the second file of `irbcal.measurement.features` has them."""
    rows = [{"feature": feature.name, "kind": feature.kind, "target": feature.target} for feature in section.features]
    for each, row in zip(section.features, rows, strict=True):
        row |= {f"{name}_mm": repr(each.known[name][0]) for name in ("radius", "offset") if name in each.known}
        row |= each.imaging
    if section.feature_column:
        rows.insert(0, {"feature": section.feature_column, "kind": section.features[0].kind, "target": ""})
    return pd.DataFrame(rows).fillna("")


def _refuse_strangers(features: FeatureSet, section: FeaturesSection, robot: Robot) -> None:
    names_known = {feature.name for feature in section.features} | {""}
    for kind, column, names in (
        ("feature", features.feature, names_known),
        ("target", features.target, set(robot.targets)),
    ):
        strange = np.flatnonzero(~np.isin(column.astype(str), list(names)))
        if len(strange):
            raise MeasurementError(
                f"the calibration does not know the {kind} {column[strange[0]]}: it has "
                f"{', '.join(sorted(names - {''}))}",
                file=features.source,
                row=int(features.row[strange[0]]),
                column=kind,
            )


def _tools(robot: Robot) -> dict[UnknownKey, FloatArray]:
    """What a robot knows of its base and targets."""
    out: dict[UnknownKey, FloatArray] = {BASE: robot.T_world_base}
    out |= {(TOOL, name): xyz for name, xyz in robot.targets.items()}
    return out | {("axes", name): turn for name, turn in robot.target_rotations.items()}


def _problem(robot: Robot, features: FeatureSet) -> FeatureProblem:
    return FeatureProblem(robot.arm, features, [], _tools(robot), robot=robot)


def _missed(problem: FeatureProblem, state: FeatureState) -> tuple[FloatArray, FloatArray]:
    """Ways (m, 3) from the model's points to their features, and these points, in the base link; NaN for angles."""
    shift, origin = np.full((2, len(problem.rows), 3), np.nan)
    for of_group in problem.group_residuals(state):
        group, R = of_group.group, of_group.view.frames[cell_graph.BASE][:, :3, :3]
        if not group.kind.pointed:
            continue
        across = np.linalg.pinv(
            of_group.residuals.point @ R, rcond=0.3
        )  # along the view images tell little: it is left out
        ways = np.einsum("mik,mk->mi", across, of_group.residuals.r)
        if of_group.residuals.size is not None:  # a picture: as long as its corners miss, as in the report
            ways *= (of_group.residuals.size / np.maximum(np.linalg.norm(ways, axis=1), 1e-15))[:, None]
        shift[group.rows] = ways
        origin[group.rows] = of_group.p
        if group.kind.name == "offset-on-tool":  # where the sensor says that the ball is
            origin[group.rows] = of_group.values["centre"] - shift[group.rows]
    return shift, origin
