"""Python: one module on numpy alone for batches, and the same on plain floats, for machines without irbcal."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Any

from irbcal.arrays import FloatArray
from irbcal.exporting.made import Made
from irbcal.exporting.parts import Parts, Vectors
from irbcal.exporting.written import render

if TYPE_CHECKING:
    from irbcal.exporting.source import Source

WHAT = "Python: a module on numpy alone, and the same on plain floats"
NEXT = "python {folder}/{word}_calibrated.py     # are its numbers right here, too?"


def files(source: Source) -> Made:
    """Two modules."""
    parts, vectors, word = source.parts, source.vectors, source.parts.identifier
    return Made(
        {
            f"{word}_calibrated.py": text(parts, vectors, "calibrated.py.j2", "numpy alone"),
            f"{word}_calibrated_plain.py": text(parts, vectors, "plain.py.j2", "nothing but Python itself"),
        }
    )


def text(parts: Parts, vectors: Vectors, template: str, needs: str) -> bytes:
    """One of the modules."""
    words: dict[str, Any] = {
        "needs": needs,
        "reach": parts.reach,
        "series": [_pairs(parts.cosine[:, j], parts.sine[:, j]) for j in range(len(parts.joint_names))],
        "waves": [(w.joint, w.cycles, w.cosine, w.sine) for w in parts.waves],
        "bends": [(b.coefficient, b.phase, b.joints, b.targets) for b in parts.bends],
        "levers": [(item.joint, item.targets, [*zip(item.links, item.vectors, strict=True)]) for item in parts.levers],
    }
    return render(template, parts, vectors, **words)


def _pairs(cosine: FloatArray, sine: FloatArray) -> list[tuple[float, float]]:
    """Cosine and sine of a joint's series, without the zeros at its end."""
    pairs = [*zip(cosine.tolist(), sine.tolist(), strict=True)]
    while pairs and pairs[-1] == (0.0, 0.0):
        pairs.pop()
    return pairs


def module(parts: Parts, vectors: Vectors, template: str = "plain.py.j2") -> ModuleType:
    """A module as it would be exported, in memory: what live correction computes with."""
    made = ModuleType(f"{parts.identifier}_calibrated")
    exec(compile(text(parts, vectors, template, ""), f"{made.__name__}.py", "exec"), made.__dict__)
    return made
