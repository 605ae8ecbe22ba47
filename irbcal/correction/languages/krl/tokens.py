"""Tokens of KRL, line by line."""

from __future__ import annotations

import re
from collections.abc import Sequence

from irbcal.correction.listing import BOM, Listing, Number
from irbcal.correction.tokens import Token

TOKEN = re.compile(
    r"""(?P<space>[ \t\f\v]+)
    |(?P<comment>;[^\r\n]*)
    |(?P<newline>\r\n|\n|\r)
    |(?P<string>"[^"\r\n]*")
    |(?P<bits>'[^'\r\n]*')
    |(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z_$]))
    |(?P<name>[$\#]?[A-Za-z_$\x80-\xff][\w$\x80-\xff]*)
    |(?P<symbol>==|<>|<=|>=|[-+*/=<>()\[\]{},:.&@?])
    |(?P<other>.)""",
    re.VERBOSE | re.DOTALL,
)


END = Token("end", "", 0, 0)


class Line:
    """The tokens of a line and a place among them.

    Attributes
    ----------
    tokens : list of Token
    part : int
        Number of the file.
    at : int
        The token that comes next.
    """

    def __init__(self, tokens: list[Token], part: int) -> None:
        self.tokens, self.part, self.at = tokens, part, 0

    @property
    def next(self) -> Token:
        """The token that comes next; `END` behind the last."""
        return self.tokens[self.at] if self.at < len(self.tokens) else END

    def word(self, ahead: int = 0) -> str:
        """Text of a token that comes; empty behind the last."""
        k = self.at + ahead
        return self.tokens[k].word if 0 <= k < len(self.tokens) else ""

    def take(self, *words: str) -> bool:
        """Whether the next token is one of these words; it is taken then."""
        if self.word() in words and self.next is not END:
            self.at += 1
            return True
        return False

    @property
    def start(self) -> int:
        """Where the line's first token stands."""
        return self.tokens[0].start

    @property
    def end(self) -> int:
        """Behind its last token."""
        return self.tokens[-1].end

    def number(self) -> Number | None:
        """A number with its sign, taken; None where there is none."""
        k = self.at
        minus = 0
        while self.word() in ("-", "+"):
            minus += self.word() == "-"
            self.at += 1
        token = self.next
        if token.kind != "number" or self.at - k > 1:
            self.at = k
            return None
        self.at += 1
        start = self.tokens[k].start
        return Number(-float(token.word) if minus else float(token.word), start, token.end)

    def index(self) -> tuple[int, ...] | None:
        """A whole index in brackets, taken, empty where there is none; None where it is computed (and taken, too)."""
        if not self.take("["):
            return ()
        out: list[int] = []
        good = True
        depth = 1
        while depth and self.next is not END:
            token = self.next
            self.at += 1
            depth += (token.word == "[") - (token.word == "]")
            if token.kind == "number" and token.word.isdecimal() and len(token.word) < 9:
                out.append(int(token.word))
            elif token.word not in ("]", ","):
                good = False
        return tuple(out) if good and out else None


def lines_of(listing: Listing) -> tuple[list[Line], list[str]]:
    """Lines with their tokens, without comments, and the comments.

    Raises
    ------
    ProgramError
        If a string is not closed in its line.
    """
    lines: list[Line] = []
    comments: list[str] = []
    for number, part in enumerate(listing.parts):
        tokens: list[Token] = []
        start = part.start + (len(BOM) if listing.text.startswith(BOM, part.start, part.end) else 0)
        for found in TOKEN.finditer(listing.text, start, part.end):
            kind = str(found.lastgroup)
            if kind == "newline":
                if tokens:
                    lines.append(Line(tokens, number))
                tokens = []
            elif kind == "comment":
                comments.append(found[0])
            elif kind == "other" and found[0] in "\"'":
                raise listing.error(found.start(), "the string is not closed in its line")
            elif kind != "space":
                tokens.append(Token(kind, found[0].lower(), found.start(), found.end()))
        if tokens:
            lines.append(Line(tokens, number))
    return lines, comments


def names_in(tokens: Sequence[Token]) -> list[Token]:
    """The names among tokens."""
    return [token for token in tokens if token.kind == "name"]
