"""One self-contained HTML page: meshcat's viewer, the recorded scene, and the panel that steps through it.

Names in it come from measurement files and URDFs, which are untrusted: they stand in the page as JSON whose ``<``,
``>`` and ``&`` are escaped, and reach the screen as text only. A content security policy allows the page's own scripts,
by their hashes, and no request to anywhere.
"""

import base64
import hashlib
import json
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from irbcal.figures.colours import ERRORS
from irbcal.units import DEG, MM


def render(scene):
    """The page of a scene.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    str
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from irbcal.viewer import drawing

    data = content(scene)
    data["commands"] = drawing.record(scene).as_text()
    scripts = {"viewer": _viewer("main.min.js"), "overlay": _own("overlay.js")}
    for name, text in scripts.items():
        if "</script" in text.lower() or "<!--" in text:
            raise AssertionError(f"the script {name} cannot stand inside a page")
    environment = Environment(loader=PackageLoader("irbcal.viewer", ""), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("page.html.j2").render(
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


def content(scene):
    """What the panel works with, as plain values; arrays are base64 of little-endian float32 or int32.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict
    """
    robot, points = scene.robot, scene.points
    arm = robot.arm
    lower = np.where(np.isfinite(arm.lower), arm.lower, np.where(scene.prismatic, -1.0, -np.pi))
    upper = np.where(np.isfinite(arm.upper), arm.upper, np.where(scene.prismatic, 1.0, np.pi))
    groups, group = np.unique(scene.groups.astype(str), return_inverse=True)
    joint_map = robot.joint_map
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
            "units": ["mm" if own else "deg" for own in scene.prismatic],
            "factors": [MM if own else DEG for own in scene.prismatic],
            "lower": lower.tolist(),
            "upper": upper.tolist(),
        },
        "joint_map": {
            "gain": np.asarray(joint_map.gain).tolist(),
            "stiffness": np.asarray(joint_map.stiffness).tolist(),
            "phases": np.asarray(joint_map.phases).tolist(),
            "fourier": np.asarray(joint_map.fourier).tolist(),
        },
        "poses": {
            "ids": [str(name) for name in scene.pose_ids],
            "groups": groups.tolist(),
            "group": group.reshape(-1).tolist(),
            "q": _floats(scene.q),
            "effective": _floats(scene.effective),
        },
        "targets": [{"name": name, "place": place.tolist()} for name, place in scene.targets.items()],
        "points": None if points is None else _points(points),
        "world": scene.T_scene_world.T.ravel().tolist(),
        "tracker": scene.tracker,
        "references": [{"name": name, "place": place.tolist()} for name, place in scene.references.items()],
        "cube": None if scene.cube is None else {"centre": scene.cube[0].tolist(), "edge": scene.cube[1]},
        "path": scene.path is not None,
        "magnification": scene.magnification,
        "scale": {"top_mm": scene.scale_top / MM, "colours": ERRORS},
    }


def _drawn(drawn):
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


def _points(points):
    """Points and errors; differences are taken before rounding to float32."""
    out = {"pose": _integers(points.pose), "target": _integers(points.target), "count": len(points.pose)}
    for model in ("calibrated", "nominal"):
        modelled = getattr(points, model)
        turn = getattr(points, f"turn_{model}")
        measured = points.measured is not None and modelled is not None
        out[model] = None if modelled is None else _floats(modelled)
        out[f"error_{model}"] = _floats(points.error(model)) if measured else None
        out[f"turn_{model}"] = None if turn is None else _floats(turn)
    out["measured"] = None if points.measured is None else _floats(points.measured)
    return out


def _floats(array):
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")


def _integers(array):
    return base64.b64encode(np.ascontiguousarray(array, dtype="<i4").tobytes()).decode("ascii")


def escaped_json(value):
    """JSON that can stand inside a script element: no character in it can end or open one."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _digest(text):
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def _own(name):
    return (files("irbcal.viewer") / name).read_text(encoding="utf-8")


def _viewer(name):
    """A file of meshcat's viewer, without importing meshcat."""
    folder = Path(find_spec("meshcat").submodule_search_locations[0])
    return (folder / "viewer" / "dist" / name).read_text(encoding="utf-8")
