"""A robot's links, joints and visual geometry, read from its URDF for drawing.

Meshes become triangles here, in Python: the page that is sent to a colleague holds numbers only, no files, and nothing
in it is fetched. A URDF is untrusted: only files with a mesh's ending below the given package folders, ROS packages
that the URDF lies in, or the URDF's own folder are opened.
"""

import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from irbcal.modeling import frames
from irbcal.viewer import shapes

MESH_ENDINGS = (".stl", ".dae", ".obj", ".glb")
MAX_MESH_BYTES = 100_000_000
MAX_TRIANGLES = 2_000_000
"""Triangles of a whole robot beyond which further visuals are left out."""

GREY = (0.78, 0.79, 0.80)
MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Link:
    """A link and the joint that carries it.

    Attributes
    ----------
    name : str
    parent : int
        Place of the parent link in the list; -1 for the root.
    T_parent_joint : ndarray, shape (4, 4)
    kind : str
        ``fixed``, ``revolute`` (continuous ones too) or ``prismatic``.
    axis : ndarray, shape (3,)
    joint : int
        Which of the arm's joints moves it; -1 for none.
    factor, offset : float
        Joint value is ``factor * q[joint] + offset`` (mimic joints).
    """

    name: str
    parent: int
    T_parent_joint: np.ndarray
    kind: str = "fixed"
    axis: np.ndarray = (0.0, 0.0, 1.0)
    joint: int = -1
    factor: float = 1.0
    offset: float = 0.0


def links(urdf):
    """All links of a robot, parents first.

    Parameters
    ----------
    urdf : UrdfArm

    Returns
    -------
    list of Link
        The first is the root; joints that are not the arm's own stand at zero.
    """
    index = {name: k for k, name in enumerate(urdf.arm.joint_names)}
    by_parent = {}
    for element in urdf.tree.getroot().findall("joint"):
        by_parent.setdefault(element.find("parent").get("link"), []).append(element)
    out = [Link(urdf.root_link, -1, np.eye(4))]
    for place, link in enumerate(out):  # the list grows while it is walked
        for element in by_parent.get(link.name, ()):
            out.append(_link(element, place, index))
    return out


def _link(element, parent, index):
    kind = element.get("type")
    name = element.get("name")
    axis = element.find("axis")
    axis = _vector((axis.get("xyz") if axis is not None else None) or "1 0 0", 3)
    joint, factor, offset = index.get(name, -1), 1.0, 0.0
    mimic = element.find("mimic")
    if mimic is not None and joint < 0:
        joint = index.get(mimic.get("joint"), -1)
        try:
            factor = _vector(mimic.get("multiplier") or "1", 1)[0]
            offset = _vector(mimic.get("offset") or "0", 1)[0]
        except ValueError:
            joint = -1  # a mimic that makes no sense stands still
    if kind not in MOVING:
        kind = "fixed"
    return Link(
        element.find("child").get("link"),
        parent,
        _origin(element),
        "prismatic" if kind == "prismatic" else "fixed" if kind == "fixed" else "revolute",
        axis / (np.linalg.norm(axis) or 1.0),
        joint,
        factor,
        offset,
    )


def place(tree, q, T_base_root=None):
    """Places of all links for one set of effective joints, as the page computes them.

    Parameters
    ----------
    tree : list of Link
    q : ndarray, shape (joints,)
        Effective joint values, radians or metres.
    T_base_root : ndarray, shape (4, 4), optional

    Returns
    -------
    ndarray, shape (links, 4, 4)
    """
    out = []
    for link in tree:
        value = (link.factor * q[link.joint] if link.joint >= 0 else 0.0) + link.offset
        T = link.T_parent_joint
        if link.kind == "revolute":
            T = T @ frames.transform(frames.rotation_from_vector(value * link.axis))
        elif link.kind == "prismatic":
            T = T @ frames.transform(None, link.axis * value)
        before = out[link.parent] if link.parent >= 0 else (np.eye(4) if T_base_root is None else T_base_root)
        out.append(before @ T)
    return np.array(out)


# --- visual geometry -----------------------------------------------------------------------------------------


def meshes(urdf, tree, folder, package_dirs=()):
    """What each link looks like.

    Parameters
    ----------
    urdf : UrdfArm
    tree : list of Link
        As `links` gives them.
    folder : Path
        Folder of the URDF; relative file names start there.
    package_dirs : sequence of str or Path
        Folders that hold ROS packages (or are one).

    Returns
    -------
    meshes : dict of int to Mesh
        By place of the link in the list.
    notes : list of str
        What could not be drawn, in one sentence at most.
    """
    root = urdf.tree.getroot()
    materials = {m.get("name"): _colour(m) for m in root.findall("material")}
    elements = {link.get("name"): link for link in root.findall("link")}
    finder = MeshFinder(folder, package_dirs)
    parts, bare, problems, budget = {}, set(), {}, MAX_TRIANGLES
    for k, link in enumerate(tree):
        for visual in elements[link.name].findall("visual"):
            try:
                triangles, colours = _visual(visual, materials, finder, budget)
            except Problem as problem:
                problems.setdefault(problem.args[0], []).append(problem.args[1])
                bare.add(k)
                continue
            budget -= len(triangles)
            parts.setdefault(k, []).append((triangles, colours))
    size = reach(tree)
    if not parts:
        bare = set(range(len(tree)))
    for k in sorted(bare - set(parts)):
        rod = _rods(tree, k, size)
        if rod is not None:
            parts[k] = [(rod, np.broadcast_to(GREY, (len(rod), 3)))]
    found = {
        k: shapes.smooth(np.concatenate([t for t, _ in own]), np.concatenate([c for _, c in own]))
        for k, own in parts.items()
    }
    return found, _problem_note(problems)


class Problem(Exception):
    """A visual that cannot be drawn: (what is wrong, which)."""


def _problem_note(problems):
    if not problems:
        return []
    count = sum(map(len, problems.values()))
    reason, which = next(iter(problems.items()))
    more = f" (and {count - 1} more)" if count > 1 else ""
    hint = "; --package-dir names the folder that holds the package" if "not found" in reason else ""
    return [f"Links without their meshes are drawn as rods: {which[0]}{more}: {reason}{hint}."]


def reach(tree):
    """Length of the longest chain of joint origins, metres: the scale of the robot."""
    lengths = []
    for link in tree:
        before = lengths[link.parent] if link.parent >= 0 else 0.0
        lengths.append(before + np.linalg.norm(link.T_parent_joint[:3, 3]))
    return max(max(lengths), 0.1)


def _visual(visual, materials, finder, budget):
    geometry = visual.find("geometry")
    shape = next((child for child in geometry if isinstance(child.tag, str)), None) if geometry is not None else None
    if shape is None:
        raise Problem("there is no geometry in the visual", "a visual")
    material = visual.find("material")
    colour = None
    if material is not None:
        colour = _colour(material)
        colour = materials.get(material.get("name")) if colour is None else colour
    try:
        T = _origin(visual)
        triangles, own = _shape(shape, finder, budget)
    except (ValueError, TypeError) as error:
        raise Problem(f"not understood ({' '.join(str(error).split())})", f"<{shape.tag}>") from None
    if own is None:
        own = np.broadcast_to(GREY if colour is None else colour, (len(triangles), 3))
    return triangles @ T[:3, :3].T + T[:3, 3], own


def _shape(shape, finder, budget):
    if shape.tag == "box":
        return shapes.box(_vector(shape.get("size"), 3)), None
    if shape.tag == "cylinder":
        return shapes.cylinder(_size(shape, "radius"), _size(shape, "length")), None
    if shape.tag == "capsule":
        return shapes.capsule(_size(shape, "radius"), _size(shape, "length")), None
    if shape.tag == "sphere":
        return shapes.sphere(_size(shape, "radius")), None
    if shape.tag == "mesh":
        triangles, colours = finder.read(shape.get("filename") or "", budget)
        scale = _vector(shape.get("scale") or "1 1 1", 3)
        triangles = triangles * scale
        if np.prod(scale) < 0:
            triangles = triangles[:, ::-1]
        return triangles, colours
    raise ValueError(f"unknown geometry {shape.tag}")


def _size(shape, name):
    value = float(shape.get(name))
    if not 0 <= value < 1e3:
        raise ValueError(f"{name} is {value:g}")
    return value


def _vector(text, count):
    values = np.array([float(part) for part in (text or "").split()])
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"expected {count} numbers, found {text!r}")
    return values


def _origin(element):
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    return frames.transform(
        frames.matrix_from_rpy(_vector(origin.get("rpy") or "0 0 0", 3)), _vector(origin.get("xyz") or "0 0 0", 3)
    )


def _colour(material):
    element = material.find("color")
    try:
        return None if element is None else _vector(element.get("rgba"), 4)[:3].clip(0, 1)
    except ValueError:
        return None


def _rods(tree, k, size):
    """A link as rods from its frame to the joints that it carries, with a drum about each moving joint."""
    radius = 0.022 * size
    parts = []
    for child in tree:
        if child.parent != k:
            continue
        end = child.T_parent_joint[:3, 3]
        if np.linalg.norm(end) > 2 * radius:
            parts.append(shapes.rod(np.zeros(3), end, radius))
    link = tree[k]
    if link.kind == "revolute":
        parts.append(shapes.rod(-1.6 * radius * link.axis, 1.6 * radius * link.axis, 1.5 * radius))
    return np.concatenate(parts) if parts else None


class MeshFinder:
    """Finds and reads mesh files that a URDF names, inside the folders that it may read.

    Parameters
    ----------
    folder : Path
        Folder of the URDF.
    package_dirs : sequence of str or Path
        Folders that hold ROS packages, or are one.
    """

    def __init__(self, folder, package_dirs=()):
        self.folder = Path(folder).resolve()
        self.packages = [Path(item).resolve() for item in package_dirs]
        self.around = [parent for parent in (self.folder, *self.folder.parents) if (parent / "package.xml").is_file()]

    def find(self, uri):
        """The file that a mesh's name stands for.

        Parameters
        ----------
        uri : str
            ``package://NAME/...``, ``file://...``, or a path.

        Returns
        -------
        Path

        Raises
        ------
        Problem
            If there is none, or if it lies outside the folders that may be read.
        """
        shown = uri if len(uri) < 120 else uri[:120] + "…"
        scheme, found, rest = uri.partition("://")
        if found and scheme not in ("package", "model", "file"):
            raise Problem("only files on this computer are read", shown)
        if "\x00" in uri:
            raise Problem("not a file name", "a mesh")
        if found and scheme != "file":
            name, _, rest = rest.partition("/")
            candidates = [(top, top / name / rest) for top in self.packages]
            candidates += [(top, top / rest) for top in (*self.packages, *self.around) if top.name == name]
        else:
            rest = rest if found else uri
            candidates = [(top, top / rest) for top in (self.folder, *self.packages, *self.around)]
        outside = False
        for top, path in candidates:
            try:
                path = path.resolve()
                if not path.is_file():
                    continue
            except (OSError, RuntimeError):  # too long, or links in a circle
                continue
            if path.is_relative_to(top):
                if path.suffix.lower() not in MESH_ENDINGS:
                    raise Problem(f"only {', '.join(MESH_ENDINGS)} files are read as meshes", shown)
                return path
            outside = True
        if outside:
            raise Problem("it lies outside the URDF's folder and the package folders", shown)
        raise Problem("the file was not found", shown)

    def read(self, uri, budget=MAX_TRIANGLES):
        """Triangles of a mesh file.

        Parameters
        ----------
        uri : str
        budget : int
            Most triangles to take.

        Returns
        -------
        triangles : ndarray, shape (m, 3, 3)
            Metres.
        colours : ndarray, shape (m, 3), or None
            Red, green, blue in 0 to 1; None where the file has no colours.

        Raises
        ------
        Problem
            If the file cannot be found, may not be read or is not understood.
        """
        path = self.find(uri)
        try:
            data = path.read_bytes() if path.stat().st_size <= MAX_MESH_BYTES else None
        except OSError as error:
            raise Problem(f"it cannot be read: {error.strerror}", path.name) from None
        if data is None:
            raise Problem(f"it is larger than {MAX_MESH_BYTES // 1_000_000} MB", path.name)
        return _read_mesh(data, path.suffix.lower()[1:], path.name, budget)


def _read_mesh(data, ending, name, budget):
    try:
        import trimesh

        if ending == "dae":
            import collada  # noqa: F401
    except ImportError as error:
        raise Problem(f"reading {ending} meshes needs the package {error.name}", name) from None
    unit = 1.0
    if ending == "dae":
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
            raise Problem("document types and entities are refused", name)
        found = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([\d.eE+-]+)[\"']", data[:100_000])
        unit = float(found[1]) if found else 1.0
    try:
        # without a resolver nothing but these bytes is read: no textures, no material files
        scene = trimesh.load_scene(BytesIO(data), file_type=ending, process=False)
        parts = list(_scene_parts(scene, budget))
    except Problem:
        raise
    except Exception as error:  # whatever a parser raises on a damaged file
        raise Problem(f"it is not a readable mesh ({type(error).__name__})", name) from None
    if not parts:
        raise Problem("there are no triangles in it", name)
    triangles = np.concatenate([part for part, _ in parts]) * unit
    good = np.isfinite(triangles).all(axis=(1, 2))
    coloured = any(colour is not None for _, colour in parts)
    colours = np.concatenate([np.broadcast_to(GREY if c is None else c, (len(t), 3)) for t, c in parts])
    return triangles[good], colours[good] if coloured else None


def _scene_parts(scene, budget):
    for node in scene.graph.nodes_geometry:
        T, name = scene.graph[node]
        part = scene.geometry[name]
        if not hasattr(part, "faces") or not len(part.faces):
            continue
        budget -= len(part.faces)
        if budget < 0:
            raise Problem(f"the robot has more than {MAX_TRIANGLES:,} triangles", name)
        triangles = part.triangles @ np.asarray(T)[:3, :3].T + np.asarray(T)[:3, 3]
        yield triangles, _part_colours(part)


def _part_colours(part):
    visual = part.visual
    if not visual.defined:
        return None
    if visual.kind == "texture":
        material = visual.material
        if getattr(material, "image", None) is not None:
            return None
        return np.asarray(material.main_color[:3], dtype=float) / 255
    return np.asarray(visual.face_colors[:, :3], dtype=float) / 255
