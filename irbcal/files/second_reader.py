"""yourdfpy, the second reader of every written URDF, without the library of meshes that it names in its signatures.

That library (trimesh, with what it brings of scipy and networkx) takes half a second to load and is for scenes. Reading
a URDF and the transforms of its joints need its `transformations` alone. All of it is loaded where anybody asks for it.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from io import BytesIO
from types import ModuleType
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray

MESHES = "trimesh"
ALONE = "_forward_kinematics_joint"
"""Its transform of one joint, which needs no scene."""


class _Later(ModuleType):
    """In the place of a package until an attribute of it is asked for; its submodules can be loaded without it."""

    def __init__(self, name: str, names: tuple[str, ...]) -> None:
        super().__init__(name)
        spec = find_spec(name)
        self.__spec__, self.__path__ = spec, list((spec and spec.submodule_search_locations) or [])
        self._names: tuple[str, ...] = names

    def __getattr__(self, name: str) -> Any:
        if name in self._names:
            return Any
        if name.startswith("__"):
            raise AttributeError(name)
        self._leave()
        return getattr(import_module(self.__name__), name)

    def _leave(self) -> None:
        """Make room for the package itself."""
        self._names = ()
        if sys.modules.get(self.__name__) is self:
            for loaded in [key for key in sys.modules if key == self.__name__ or key.startswith(f"{self.__name__}.")]:
                del sys.modules[loaded]


def yourdfpy() -> ModuleType:
    """The package, which loads meshes' library when a scene is built."""
    if "yourdfpy" in sys.modules or MESHES in sys.modules or find_spec(MESHES) is None:
        return import_module("yourdfpy")
    later = _Later(MESHES, ("Scene", "Trimesh"))  # the names in its signatures
    sys.modules[MESHES] = later
    try:
        return import_module("yourdfpy")
    finally:
        later._leave()


def poses(urdf_bytes: bytes, joint_names: tuple[str, ...], base: str, tip: str, q: FloatArray) -> FloatArray:
    """Tip poses in the base link by yourdfpy: its reading of the file, and the product of its joints' transforms.

    Parameters
    ----------
    urdf_bytes : bytes
        Content of the URDF.
    joint_names : tuple of str
    base, tip : str
        Links.
    q : ndarray, shape (n, joints)
        Effective joints, radians (metres for prismatic joints).

    Returns
    -------
    ndarray, shape (n, 4, 4)
    """
    reader = yourdfpy().URDF
    alone = hasattr(reader, ALONE)  # another version may have it under another name: then with its scene
    robot = reader.load(
        BytesIO(urdf_bytes), build_scene_graph=not alone, load_meshes=False, build_collision_scene_graph=False
    )
    above = {joint.child: joint for joint in robot.robot.joints}

    def from_root(link: str) -> FloatArray:
        T = np.eye(4)
        while link in above:
            T = getattr(robot, ALONE)(above[link])[0] @ T
            link = above[link].parent
        return T

    out = np.empty((len(q), 4, 4))
    for k, row in enumerate(q.tolist()):
        robot.update_cfg(dict(zip(joint_names, row, strict=True)))
        out[k] = np.linalg.solve(from_root(base), from_root(tip)) if alone else robot.get_transform(tip, base)
    return out
