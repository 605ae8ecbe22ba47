"""Words of a program's text, and lists of numbers among them, for the readers of several languages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from irbcal.correction.listing import Number


class Token(NamedTuple):
    """A word of a program.

    Attributes
    ----------
    kind : str
        As the language's reader calls it: ``number``, ``name``, ``symbol`` …
    word : str
        As it stands there; names in lower case where the language does not mind.
    start, end : int
        Place in the text.
    """

    kind: str
    word: str
    start: int
    end: int


Tokens = Sequence[Token]


def numbers(tokens: Tokens, brackets: Sequence[str] = ("[]",)) -> list[Number] | None:
    """Numbers of a whole list in brackets with commas between them, such as ``[1, -2.5]``.

    Parameters
    ----------
    tokens : sequence of Token
    brackets : sequence of str
        Pairs that may be around it.

    Returns
    -------
    list of Number or None
        None where it is no such list, or not all of plain numbers.
    """
    if len(tokens) < 3 or tokens[0].word + tokens[-1].word not in brackets:
        return None
    out: list[Number] = []
    k = 1
    while k < len(tokens) - 1:
        start, sign = tokens[k].start, 1.0
        if tokens[k].word in ("-", "+"):
            sign = -1.0 if tokens[k].word == "-" else 1.0
            k += 1
        if tokens[k].kind != "number":
            return None
        out.append(Number(sign * float(tokens[k].word), start, tokens[k].end))
        k += 1
        if k == len(tokens) - 1:
            return out
        if tokens[k].word != ",":
            return None
        k += 1
    return None
