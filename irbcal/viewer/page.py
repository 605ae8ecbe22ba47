"""One self-contained HTML page: meshcat's viewer, the recorded scene, and the panel that steps through it.

Names in it come from measurement files and URDFs, which are untrusted: they stand in the page as JSON whose ``<``,
``>`` and ``&`` are escaped, and reach the screen as text only. A content security policy allows the page's own scripts,
by their hashes, and no request to anywhere.
"""

from __future__ import annotations

import base64
import hashlib
import json
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.modeling.joint_map import JointMap
from irbcal.plotting.colours import ERRORS
from irbcal.units import DEG, MM
from irbcal.viewer.scene import Drawn, Model, PageScene, Points

SCRIPTS = (
    "begin",
    "robots",
    "errors",
    "layers",
    "pose",
    "list",
    "playing",
    "camera",
    "labels",
    "pick",
    "panel",
    "keys",
)
"""Parts of the page's own script, in the order in which they run."""


def render(scene: PageScene) -> str:
    """The page of a scene.

    Parameters
    ----------
    scene : PageScene
    """
    from irbcal.templates import environment
    from irbcal.viewer import drawing

    data = content(scene)
    data["commands"] = drawing.record(scene).as_text()
    script = "".join(_own(f"script/{name}.js") for name in SCRIPTS)
    scripts = {"viewer": _viewer("main.min.js"), "overlay": f'"use strict";\n(function () {{\n{script}}})();\n'}
    for name, text in scripts.items():
        if "</script" in text.lower() or "<!--" in text:
            raise AssertionError(f"the script {name} cannot stand inside a page")
    return (
        environment("irbcal.viewer", "", trim=False)
        .get_template("page.html.j2")
        .render(
            title=scene.title,
            data=escaped_json(data),
            licences=_viewer("main.min.js.LICENSE.txt"),
            style=_own("overlay.css"),
            policy="; ".join(
                [
                    "default-src 'none'",
                    "script-src " + " ".join(f"'sha256-{_digest(text)}'" for text in scripts.values()),
                    "style-src 'unsafe-inline'",
                    "img-src data: blob:",
                    "base-uri 'none'",
                    "form-action 'none'",
                ]
            ),
            **scripts,
        )
    )


def content(scene: PageScene) -> dict[str, Any]:
    """What the panel works with, as plain values; arrays are base64 of little-endian float32 or int32.

    Parameters
    ----------
    scene : PageScene
    """
    robot, points = scene.robot, scene.points
    arm = robot.arm
    lower = np.where(np.isfinite(arm.lower), arm.lower, np.where(scene.prismatic, -1.0, -np.pi))
    upper = np.where(np.isfinite(arm.upper), arm.upper, np.where(scene.prismatic, 1.0, np.pi))
    groups, group = np.unique(scene.groups.astype(str), return_inverse=True)
    return {
        "title": scene.title,
        "simulated": scene.simulated,
        "mode": scene.mode,
        "notes": scene.notes,
        "robot": _drawn(scene.drawn),
        "ghost": None if scene.ghost is None else _drawn(scene.ghost),
        "meshes": sorted(scene.meshes),
        "reach": scene.reach,
        "joints": {
            "names": list(arm.joint_names),
            "units": ["mm" if slides else "deg" for slides in scene.prismatic],
            "factors": [MM if slides else DEG for slides in scene.prismatic],
            "lower": lower.tolist(),
            "upper": upper.tolist(),
        },
        "joint_map": _joint_map(robot.joint_map),
        "poses": {
            "ids": [str(name) for name in scene.pose_ids],
            "groups": groups.tolist(),
            "group": group.reshape(-1).tolist(),
            "q": _floats(scene.q),
            "effective": _floats(scene.effective),
            "fitted": None if scene.fitted is None else scene.fitted.tolist(),
        },
        "targets": [{"name": name, "place": xyz.tolist()} for name, xyz in scene.targets.items()],
        "points": None if points is None else _points(points),
        "world": scene.T_scene_world.T.ravel().tolist(),
        "tracker": scene.tracker,
        "references": [{"name": name, "place": xyz.tolist()} for name, xyz in scene.references.items()],
        "features": [
            {"label": feature.label, "kind": feature.kind, "place": feature.T_scene[:3, 3].tolist()}
            for feature in scene.features
        ],
        "at_features": scene.at_features,
        "cell": [{"label": one.label, "place": one.T[:3, 3].tolist(), "on_tip": one.on_tip} for one in scene.cell],
        "cube": None if scene.cube is None else {"centre": scene.cube[0].tolist(), "edge": scene.cube[1]},
        "path": scene.path is not None,
        "scale": {
            "colours": ERRORS,
            "common": _scale(scene.magnification, scene.scale_top),
            **{model: _scale(*scales) for model, scales in scene.own_scales.items()},
        },
    }


def _scale(magnification: float, top: float) -> dict[str, float]:
    return {"magnification": magnification, "top_mm": top / MM}


def _joint_map(joint_map: JointMap) -> dict[str, Any]:
    """The coefficients for the sliders; of a map of terms gains, waves and levers, with the nominal arm's frames."""
    return joint_map.static_parts()


def _drawn(drawn: Drawn) -> dict[str, Any]:
    return {
        "root": drawn.T_scene_root.T.ravel().tolist(),
        "tip": drawn.tip,
        "links": [
            {
                "parent": link.parent,
                "origin": link.T_parent_joint.T.ravel().tolist(),
                "kind": link.kind,
                "axis": np.asarray(link.axis, dtype=float).tolist(),
                "joint": link.joint,
                "factor": link.factor,
                "offset": link.offset,
            }
            for link in drawn.links
        ],
    }


def _points(points: Points) -> dict[str, Any]:
    """Points and errors; differences are taken before rounding to float32."""
    turns = {"calibrated": points.turn_calibrated, "nominal": points.turn_nominal}
    out: dict[str, Any] = {
        "pose": _integers(points.pose),
        "target": _integers(points.target),
        "count": len(points.pose),
        "measured": _floats_if(points.measured),
        "calibrated": _floats_if(points.calibrated),
        "nominal": _floats_if(points.nominal),
        **{f"turn_{model}": _floats_if(turn) for model, turn in turns.items()},
        "u95": _floats_if(points.u95),
        "attitudes": {model: _floats(values) for model, values in points.attitudes.items()},
        "without": {family: _floats(shift) for family, shift in points.without.items()},
    }
    models: tuple[Model, ...] = ("calibrated", "nominal")
    return out | {f"error_{model}": _floats_if(points.error(model)) for model in models}


def _floats_if(array: FloatArray | None) -> str | None:
    return None if array is None else _floats(array)


def _floats(array: ArrayLike) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")


def _integers(array: ArrayLike) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype="<i4").tobytes()).decode("ascii")


def escaped_json(value: Any) -> str:
    """JSON that can stand inside a script element: no character in it can end or open one."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def _own(name: str) -> str:
    return (files("irbcal.viewer") / name).read_text(encoding="utf-8")


def _viewer(name: str) -> str:
    """A file of meshcat's viewer, without importing meshcat."""
    spec = find_spec("meshcat")
    assert spec is not None, "meshcat is a dependency"
    assert spec.submodule_search_locations, "meshcat is a package"
    folder = Path(spec.submodule_search_locations[0])
    return (folder / "viewer" / "dist" / name).read_text(encoding="utf-8")
