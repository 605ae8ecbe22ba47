"""Python: one module on numpy alone for batches, and the same on plain floats, for machines without irbcal.

What they compute stands in `irbcal.exporting.batch` and `irbcal.exporting.plain`: an export is that very text with the
constants of a calibration behind it. irbcal itself gives the constants to these classes, and never runs what it wrote.
"""

from __future__ import annotations

import inspect
from types import ModuleType
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from irbcal.arrays import FloatArray
from irbcal.exporting import batch, plain
from irbcal.exporting.parts import ExportFiles, Parts, Vectors, render

if TYPE_CHECKING:
    from irbcal.exporting.source import Source

WHAT = "Python: a module on numpy alone, and the same on plain floats"
NEXT = "python {folder}/{word}_calibrated.py     # are its numbers right here, too?"

ARRAYS = (
    *("slides", "lower", "upper", "speed", "coupling", "gravity", "gain", "offset", "compliance"),
    *("direction", "width", "move", "share", "stride"),
)
"""Of `Parts`, taken as they are."""


def files(source: Source) -> ExportFiles:
    """Two modules."""
    parts, vectors, word = source.parts, source.vectors, source.parts.identifier
    return ExportFiles(
        {
            f"{word}_calibrated.py": text(parts, vectors),
            f"{word}_calibrated_plain.py": text(parts, vectors, plain),
        }
    )


def text(parts: Parts, vectors: Vectors, code: ModuleType = batch) -> bytes:
    """A module: `batch` or `plain` with the constants of a calibration."""
    values = {
        "code": Markup(inspect.getsource(code)),
        "needs": {batch: "numpy alone", plain: "nothing but Python itself"}[code],
        "robot": {batch: "Batch", plain: "Plain"}[code],
        "constants": constants(parts, vectors),
    }
    return render("python.py.j2", parts, vectors, **values)


def constants(parts: Parts, vectors: Vectors) -> dict[str, Any]:
    """The constants of a calibration, by their names: what `plain.Plain` and `batch.Batch` are made of.

    Returns
    -------
    dict
        Metres, radians, kilograms, in numbers, texts, tuples and dicts of Python.
    """
    chains = {
        name: {
            "R": chain.rotations.tolist(),
            "p": chain.places.tolist(),
            "tip_R": chain.tip_rotation.tolist(),
            "tip_p": chain.tip_place.tolist(),
        }
        for name, chain in (("CHAIN", parts.chain), ("NOMINAL", parts.nominal))
    }
    return {
        "VERSION": parts.version,
        "FINGERPRINT": parts.fingerprint,
        "SIMULATED": parts.simulated,
        "JOINT_NAMES": parts.joint_names,
        "BASE_LINK": parts.base_link,
        "TIP_LINK": parts.tip_link,
        "JOINTS": len(parts.joint_names),
        "REACH": parts.reach,
        **{name.upper(): getattr(parts, name).tolist() for name in ARRAYS},
        **chains,
        "SERIES": [_pairs(parts.cosine[:, j], parts.sine[:, j]) for j in range(len(parts.joint_names))],
        "WAVES": [(w.joint, w.cycles, w.cosine, w.sine) for w in parts.waves],
        "BENDS": [(b.coefficient, b.phase, b.joints, b.targets) for b in parts.bends],
        "LEVERS": [
            (lever.joint, lever.targets, [*zip(lever.links, lever.vectors, strict=True)]) for lever in parts.levers
        ],
        "PAYLOAD_KG": parts.payload_kg,
        "PAYLOAD_PLACE": parts.payload_place.tolist(),
        "HAS_HISTORY": parts.has_history,
        "PROPORTIONAL": {name: (usual, c.tolist(), each) for name, (usual, c, each) in parts.proportional.items()},
        "TESTS": {name: getattr(vectors, name).tolist() for name in ("q", "effective", "tip")}
        | {"inputs": {name: values.tolist() for name, values in vectors.inputs.items()}},
    }


def _pairs(cosine: FloatArray, sine: FloatArray) -> list[tuple[float, float]]:
    """Cosine and sine of a joint's series, without the zeros at its end."""
    pairs = [*zip(cosine.tolist(), sine.tolist(), strict=True)]
    while pairs and pairs[-1] == (0.0, 0.0):
        pairs.pop()
    return pairs
