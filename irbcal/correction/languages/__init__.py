"""Robot programs: one folder a language.

A language is a package in this folder, listed in `known`, that offers what `Language` says: its name, the endings of
its files, ``read_for`` and ``fingerprint``. What it reads is a `irbcal.correction.program.Program`: the targets that
may be corrected, and the way back into the file.

A language whose targets stand as numbers in a text derives its programs from
`irbcal.correction.text_program.TextProgram`, which replaces these numbers and keeps every other byte; what is left to
do is to find the targets and the frames that they refer to, and to say in ``marked`` how a corrected program is
marked. ``rapid`` is one of these, ``table`` (CSV) stands on its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from irbcal.arrays import FloatArray
from irbcal.correction.program import Program, read_bytes
from irbcal.errors import ProgramError
from irbcal.modeling.arm import Arm


class Language(Protocol):
    """What a language must offer."""

    @property
    def NAME(self) -> str:
        """For messages."""
        ...

    @property
    def ENDINGS(self) -> tuple[str, ...]:
        """Of its files, lower case, with the dot."""
        ...

    def read_for(
        self,
        arm: Arm,
        path: str | Path,
        tools: Mapping[str, FloatArray],
        work_objects: Mapping[str, FloatArray],
    ) -> Program:
        """Read a program for an arm.

        Parameters
        ----------
        arm : Arm
            What the controller computes with.
        path : str or Path
        tools, work_objects : dict of str to ndarray, shape (4, 4)
            ``T_tip_tcp`` and ``T_base_wobj`` in metres that the program does not define, by names in lower case.

        Raises
        ------
        ProgramError
            If the file cannot be read or understood, or the language cannot serve this arm.
        OptionError
            If frames are given to a language that knows none.
        """
        ...

    def fingerprint(self, data: bytes, source: str) -> str | None:
        """Fingerprint in the mark of a program.

        Parameters
        ----------
        data : bytes
            The file.
        source : str
            File name for messages.

        Returns
        -------
        str or None
            None for a program without mark; empty where the mark does not say.

        Raises
        ------
        ProgramError
            If the file is not of this language.
        """
        ...


def known() -> tuple[Language, ...]:
    """All languages."""
    from irbcal.correction.languages import rapid, table

    return rapid, table


def of(path: str | Path) -> Language:
    """The language of a file, by its ending.

    Raises
    ------
    ProgramError
        If no language has such files, or there is no file to read.
    """
    ending = Path(path).suffix.lower()
    for language in known():
        if ending in language.ENDINGS:
            return language
    read_bytes(path)  # whatever else is wrong with it is said first
    expected = " or ".join(f"{language.NAME} ({', '.join(language.ENDINGS)})" for language in known())
    found = f"the ending {ending}" if ending else "a name without ending"
    raise ProgramError(f"expected a program in {expected}, found {found}", file=path)
