"""Tokens of RAPID modules, and where they stand."""

from __future__ import annotations

import bisect
import re
from functools import partial
from itertools import islice

from irbcal.correction.tokens import Token
from irbcal.errors import ProgramError

_WORDS = (
    "module endmodule proc endproc func endfunc trap endtrap record endrecord alias const pers var local task "
    "if then elseif else endif for from to step do endfor while endwhile test case default endtest goto return "
    "error undo backward raise retry trynext exit connect with"
)
_OPERATORS = "div mod and or not xor"
STRUCTURE = frozenset(_WORDS.split())
OPERATORS = frozenset(_OPERATORS.split())
RESERVED = STRUCTURE | OPERATORS | {"true", "false"}

_SPACE = r"[ \t\r\n\f\v]*"
_NUMBER = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
TOKEN = re.compile(
    rf"""{_SPACE}
    (?:(?P<list>\[{_SPACE}[+-]?{_NUMBER}(?:{_SPACE},{_SPACE}[+-]?{_NUMBER})*{_SPACE}\])
    |(?P<symbol>:=|<>|<=|>=|\.(?![0-9])|[-+*/=<>()\[\]{{}},;:\\?|%])
    |(?P<number>(?!0[xXbBoO][0-9a-fA-F]){_NUMBER})
    |(?P<name>[^\W\d]\w*)
    |(?P<comment>![^\r\n]*)
    |(?P<string>"(?:[^"\r\n]|"")*")
    |(?P<hex>0[xXbBoO][0-9a-fA-F]+)
    |(?P<other>[^ \t\r\n\f\v]))""",
    re.VERBOSE,
)
"""A list of plain numbers is one token, whose word is its bracket: most of a long module are such lists."""
_LIST, _NAME = TOKEN.groupindex["list"], TOKEN.groupindex["name"]
_KINDS = ("", *sorted(TOKEN.groupindex, key=lambda kind: TOKEN.groupindex[kind]))


def decode(data: bytes, source: str) -> tuple[str, str]:
    """Text and encoding of a file that is UTF-8 or Latin-1; ``text.encode(encoding)`` gives the bytes back."""
    if b"\x00" in data:
        raise ProgramError("expected a RAPID module in text, found binary data", file=source)
    try:
        return data.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        return data.decode("latin-1"), "latin-1"


class Scanner:
    """The tokens of a text, or as many of the first ones as are wanted.

    Attributes
    ----------
    tokens : list of Token
        The last one is of the kind ``end``, without a word.
    comments : list of str
    lines : list of int
        Where the lines begin.
    """

    def __init__(self, text: str, source: str, most: int | None = None) -> None:
        self.text, self.source = text, source
        self.lines = [0, *(found.end() for found in re.finditer(r"\r\n|\n|\r", text))]
        self.tokens: list[Token] = []
        self.comments: list[str] = []
        self._tokenize(most)

    def line(self, position: int) -> int:
        """Line of a position in the text, the first being 1."""
        return bisect.bisect_right(self.lines, position)

    def column(self, position: int) -> int:
        """Column of a position in the text, the first being 1."""
        return position - self.lines[self.line(position) - 1] + 1

    def error(self, position: int, message: str) -> ProgramError:
        """A refusal that names the line."""
        return ProgramError(message, file=self.source, line=self.line(position))

    def quote(self, start: int, end: int) -> str:
        """A piece of the program for a message: one line, not long."""
        text = " ".join(self.text[start:end].split())
        return text if len(text) <= 50 else text[:49] + "…"

    def quote_line(self, line: int) -> str:
        """A line of the program for a message."""
        end = self.lines[line] if line < len(self.lines) else len(self.text)
        return self.quote(self.lines[line - 1], end)

    def _tokenize(self, most: int | None) -> None:
        make, append = partial(tuple.__new__, Token), self.tokens.append  # half the time of Token(…)
        for found in islice(TOKEN.finditer(self.text, 1 if self.text.startswith("\ufeff") else 0), most):
            k, end = found.lastindex, found.end()
            assert k is not None
            word = found[k]
            if k == _LIST:
                append(make(("list", "[", end - len(word), end)))
            elif k < _NAME:
                append(make((_KINDS[k], word, end - len(word), end)))
            elif k == _NAME:
                append(make(("name", word.lower(), end - len(word), end)))
            elif _KINDS[k] == "comment":
                self.comments.append(word)
            elif _KINDS[k] == "other":
                what = "the string is not closed in its line" if word == '"' else f"unexpected character {word!r}"
                raise self.error(end - 1, what)
            else:
                append(make((_KINDS[k], word, end - len(word), end)))
        append(Token("end", "", len(self.text), len(self.text)))
