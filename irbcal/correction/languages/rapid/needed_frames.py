"""The tools and work objects that the targets of a RAPID module need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from irbcal.arrays import FloatArray
from irbcal.correction.languages.rapid.frames import read_frame
from irbcal.correction.languages.rapid.parts import Literal
from irbcal.correction.languages.rapid.syntax import Reader
from irbcal.correction.text_program import Use
from irbcal.errors import ProgramError


def needed_frames(
    reader: Reader, literals: Sequence[Literal], given: Mapping[str, Mapping[str, FloatArray]]
) -> dict[str, dict[str, FloatArray]]:
    """Frames of the tools and work objects that correctable poses need, and those of joint targets that are known.

    Parameters
    ----------
    reader : Reader
    literals : sequence of Literal
        With all their uses and reasons.
    given : dict of str to dict of str to ndarray
        Frames from the caller, by ``tooldata`` and ``wobjdata`` and by name; they go before those of the module.

    Returns
    -------
    dict of str to dict of str to ndarray
        As ``given``.

    Raises
    ------
    ProgramError
        If one cannot be had.
    """
    found: dict[str, dict[str, FloatArray]] = {"tooldata": {}, "wobjdata": {}}
    missing: dict[tuple[str, str], Use] = {}
    for literal in literals:
        needed = literal.kind == "pose" and not literal.reasons
        for use in literal.uses:
            for type_name, name in (("tooldata", use.tool), ("wobjdata", use.work_object)):
                if name is None or name in found[type_name]:
                    continue
                if name in given[type_name]:
                    found[type_name][name] = given[type_name][name]
                elif name in reader.data:
                    try:
                        found[type_name][name] = read_frame(reader, reader.data[name], use.line)
                    except ProgramError:
                        if needed:
                            raise
                elif needed:
                    missing.setdefault((type_name, name), use)
    if missing:
        raise _not_defined(reader, missing)
    return found


def _not_defined(reader: Reader, missing: Mapping[tuple[str, str], Use]) -> ProgramError:
    entries = sorted(missing.items(), key=lambda entry: entry[1].line)
    texts = [f"{'tool' if type_name == 'tooldata' else 'work object'} {name}" for (type_name, name), _ in entries]
    first = entries[0][1]
    more = [f"{text} in line {use.line}" for text, (_, use) in zip(texts[1:], entries[1:], strict=True)]
    also = f" (also: {', '.join(more)})" if more else ""
    message = f"{first.instruction} uses the {texts[0]}, which this module does not define: give its frame{also}"
    return ProgramError(message, file=reader.source, line=first.line)
