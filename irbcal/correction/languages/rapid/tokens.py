"""Tokens, values and expressions of RAPID modules."""

import bisect
import re
from functools import partial
from typing import NamedTuple

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
CLOSING = {"(": ")", "{": "}"}
DEEPEST = 12  # lists in lists

TOKEN = re.compile(
    r"""(?P<space>[ \t\r\n\f\v]+)
    |(?P<comment>![^\r\n]*)
    |(?P<string>"(?:[^"\r\n]|"")*")
    |(?P<hex>0[xXbBoO][0-9a-fA-F]+)
    |(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)
    |(?P<name>[^\W\d]\w*)
    |(?P<symbol>:=|<>|<=|>=|[-+*/=<>()\[\]{},;:.\\?|%])
    |(?P<other>.)""",
    re.VERBOSE | re.DOTALL,
)


class Token(NamedTuple):
    """A word of the program; names in lower case."""

    kind: str
    word: str
    start: int
    end: int


class Node(NamedTuple):
    """A value: a list of values, a plain number, or (both None) any other expression."""

    items: list | None
    number: float | None
    start: int
    end: int


class Mention(NamedTuple):
    """A name in any other place."""

    scope: dict | None
    name: str
    index: tuple
    start: int


def decode(data, source):
    """Text and encoding of a file that is UTF-8 or Latin-1; ``text.encode(encoding)`` gives the bytes back."""
    if b"\x00" in data:
        raise ProgramError(f"{source}: expected a RAPID module in text, found binary data")
    try:
        return data.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        return data.decode("latin-1"), "latin-1"


class Scanner:
    """The tokens of a module and a walk over its expressions.

    Attributes
    ----------
    tokens : list of Token
        The last one is of the kind ``end``, without a word.
    comments : list of str
    scope : dict or None
        Data of the routine that is being read; None outside routines.
    mentions : list of Mention
        Names seen in expressions.
    """

    def __init__(self, text, source):
        self.text, self.source = text, source
        self.lines = [0, *(found.end() for found in re.finditer(r"\r\n|\n|\r", text))]
        self.tokens, self.comments, self.mentions = [], [], []
        self.scope, self.level = None, 0
        self._tokenize()

    def line(self, position):
        """Line of a position in the text, the first being 1."""
        return bisect.bisect_right(self.lines, position)

    def column(self, position):
        """Column of a position in the text, the first being 1."""
        return position - self.lines[self.line(position) - 1] + 1

    def error(self, position, message):
        """A refusal that names the line."""
        return ProgramError(f"{self.source}: line {self.line(position)}: {message}")

    def quote(self, start, end):
        """A piece of the program for a message: one line, not long."""
        text = " ".join(self.text[start:end].split())
        return text if len(text) <= 50 else text[:49] + "…"

    def quote_line(self, line):
        """A line of the program for a message."""
        end = self.lines[line] if line < len(self.lines) else len(self.text)
        return self.quote(self.lines[line - 1], end)

    def _tokenize(self):
        make, append = partial(tuple.__new__, Token), self.tokens.append  # half the time of Token(…)
        for found in TOKEN.finditer(self.text, 1 if self.text.startswith("\ufeff") else 0):
            kind = found.lastgroup
            if kind == "symbol" or kind == "number":
                append(make((kind, found[0], *found.span())))
            elif kind == "name":
                append(make((kind, found[0].lower(), *found.span())))
            elif kind == "comment":
                self.comments.append(found[0])
            elif kind == "other":
                char = found[0]
                what = "the string is not closed in its line" if char == '"' else f"unexpected character {char!r}"
                raise self.error(found.start(), what)
            elif kind != "space":
                append(make((kind, found[0], *found.span())))
        append(Token("end", "", len(self.text), len(self.text)))

    def _found(self, i):
        token = self.tokens[i]
        return "the end of the file" if token.kind == "end" else repr(self.quote(token.start, token.end))

    def _expect(self, i, word):
        if self.tokens[i].word != word:
            raise self.error(self.tokens[i].start, f"expected {word!r}, found {self._found(i)}")
        return i + 1

    def _name(self, i, what):
        if not self._is_data(i):
            raise self.error(self.tokens[i].start, f"expected {what}, found {self._found(i)}")
        return self.tokens[i]

    def _is_data(self, i):
        """Whether token i can be the name of something."""
        return self.tokens[i].kind == "name" and self.tokens[i].word not in RESERVED

    def _is_member(self, i):
        """Whether token i is a component after a dot or the name of an optional argument."""
        return self.tokens[i - 1].word in (".", "\\")

    def _bracket(self, stack, i):
        """Keep the brackets ``( )`` and ``{ }`` in pairs within a statement."""
        kind, word = self.tokens[i].kind, self.tokens[i].word
        if kind != "symbol":
            return
        if word in CLOSING:
            stack.append(word)
        elif word in ")}]":
            if not stack or CLOSING[stack.pop()] != word:
                raise self.error(self.tokens[i].start, f"{word!r} closes nothing")
        elif word == ";" and stack:
            raise self.error(self.tokens[i].start, f"expected {CLOSING[stack[-1]]!r}, found ';'")

    def _mention(self, i):
        """Note a name that stands for data; components after a dot and names of optional arguments do not."""
        if self.tokens[i].word not in RESERVED and not self._is_member(i):
            _, word, start, _ = self.tokens[i]
            self.mentions.append(Mention(self.scope, word, self._plain_index(i + 1), start))

    def _whole(self, i):
        """Value of a whole number; None for any other token."""
        word = self.tokens[i].word
        return int(word) if self.tokens[i].kind == "number" and word.isdecimal() and len(word) < 10 else None

    def _plain_index(self, i):
        """Index such as ``{1,2}`` that begins at token i, if it is all of plain whole numbers; else empty."""
        index = []
        while self.tokens[i].word == ("," if index else "{") and self._whole(i + 1) is not None:
            index.append(self._whole(i + 1))
            i += 2
        return tuple(index) if index and self.tokens[i].word == "}" else ()

    def _expression(self, i, stops):
        """Walk over any expression to the first of ``stops`` outside brackets; returns the number of its token."""
        begin, stack, operand = i, [], False
        while True:
            kind, word, start, _ = self.tokens[i]
            symbol = kind == "symbol"
            if symbol and not stack and word in stops:
                if i == begin:
                    raise self.error(start, f"expected a value, found {self._found(i)}")
                return i
            structure = word in STRUCTURE and not self._is_member(i)
            if kind == "end" or structure or word in (";", "]") or (word == ":=" and not stack):
                expected = f"'{CLOSING[stack[-1]]}'" if stack else " or ".join(f"'{stop}'" for stop in stops)
                raise self.error(start, f"expected {expected}, found {self._found(i)}")
            value = not symbol and word not in OPERATORS
            if operand and (value or word == "["):
                raise self.error(start, f"expected an operator or '{stops[-1]}', found {self._found(i)}")
            if word == "[":
                _, i = self._list(i)
                operand = True
                continue
            if kind == "name":
                self._mention(i)
            self._bracket(stack, i)
            operand = value or word in (")", "}")
            i += 1

    def _list(self, i):
        """A list of values that begins at token i: its node and the number of the token behind it."""
        start, items = self.tokens[i].start, []
        if self.level == DEEPEST:
            raise self.error(start, f"more than {DEEPEST} lists within each other")
        self.level += 1
        while True:
            i += 1
            if self.tokens[i].word == "[":
                node, i = self._list(i)
            else:
                node, i = self._item(i)
            items.append(node)
            if self.tokens[i].word not in (",", "]"):
                raise self.error(self.tokens[i].start, f"expected ',' or ']', found {self._found(i)}")
            if self.tokens[i].word == "]":
                self.level -= 1
                return Node(items, None, start, self.tokens[i].end), i + 1

    def _item(self, i):
        kind, word, start, end = self.tokens[i]
        if kind == "number" and self.tokens[i + 1].word in (",", "]"):  # nearly all are
            return Node(None, float(word), start, end), i + 1
        j = self._expression(i, (",", "]"))
        start, end = self.tokens[i].start, self.tokens[j - 1].end
        signed = (
            j - i == 2
            and self.tokens[i].word in ("-", "+")
            and not any(char in self.text[start:end] for char in "!\r\n")
        )
        if self.tokens[j - 1].kind == "number" and (j - i == 1 or signed):
            number = float(self.tokens[j - 1].word)
            return Node(None, -number if self.tokens[i].word == "-" else number, start, end), j
        return Node(None, None, start, end), j

    def _index(self, i):
        """Index that begins at token i: whole numbers, None for computed ones; and the number of the token behind."""
        parts = []
        while not parts or self.tokens[i].word == ",":
            j = self._expression(i + 1, (",", "}"))
            parts.append(self._whole(i + 1) if j == i + 2 else None)
            i = j
        return tuple(parts), i + 1

    def _behind_index(self, i):
        """Number of the token behind the braces that begin at token i; 0 if they do not end in the statement."""
        depth = 0
        while self.tokens[i].word not in (";", ""):
            depth += (self.tokens[i].word == "{") - (self.tokens[i].word == "}")
            i += 1
            if depth == 0:
                return i
        return 0
