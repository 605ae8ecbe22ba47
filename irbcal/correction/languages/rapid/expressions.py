"""Values and expressions of RAPID modules: a walk over tokens that notes every name on its way."""

from __future__ import annotations

from functools import partial

from irbcal.correction.languages.rapid.parts import Index, Mention, Node, Scope
from irbcal.correction.languages.rapid.tokens import OPERATORS, RESERVED, STRUCTURE, Scanner
from irbcal.correction.tokens import Token

CLOSING = {"(": ")", "{": "}"}
DEEPEST = 12  # lists in lists
_NODE = partial(tuple.__new__, Node)  # half the time of Node(…)


class Walker(Scanner):
    """The tokens of a module and a walk over its expressions.

    Attributes
    ----------
    scope : dict or None
        Data of the routine that is being read; None outside routines.
    mentions : list of Mention
        Names seen in expressions.
    """

    def __init__(self, text: str, source: str, most: int | None = None) -> None:
        super().__init__(text, source, most)
        self.mentions: list[Mention] = []
        self.scope: Scope | None = None
        self.level = 0

    def _found(self, i: int) -> str:
        token = self.tokens[i]
        end = token.start + 1 if token.kind == "list" else token.end
        return "the end of the file" if token.kind == "end" else repr(self.quote(token.start, end))

    def _expect(self, i: int, word: str) -> int:
        if self.tokens[i].word != word:
            raise self.error(self.tokens[i].start, f"expected {word!r}, found {self._found(i)}")
        return i + 1

    def _name(self, i: int, what: str) -> Token:
        if not self._is_data(i):
            raise self.error(self.tokens[i].start, f"expected {what}, found {self._found(i)}")
        return self.tokens[i]

    def _is_data(self, i: int) -> bool:
        """Whether token i can be the name of something."""
        return self.tokens[i].kind == "name" and self.tokens[i].word not in RESERVED

    def _is_member(self, i: int) -> bool:
        """Whether token i is a component after a dot or the name of an optional argument."""
        return self.tokens[i - 1].word in (".", "\\")

    def _bracket(self, stack: list[str], i: int) -> None:
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

    def _mention(self, i: int) -> None:
        """Note a name that stands for data; components after a dot and names of optional arguments do not."""
        if self.tokens[i].word not in RESERVED and not self._is_member(i):
            _, word, start, _ = self.tokens[i]
            self.mentions.append(Mention(self.scope, word, self._plain_index(i + 1), start))

    def _whole(self, i: int) -> int | None:
        """Value of a whole number; None for any other token."""
        word = self.tokens[i].word
        return int(word) if self.tokens[i].kind == "number" and word.isdecimal() and len(word) < 10 else None

    def _plain_index(self, i: int) -> Index:
        """Index such as ``{1,2}`` that begins at token i, if it is all of plain whole numbers; else empty."""
        index: list[int | None] = []
        while self.tokens[i].word == ("," if index else "{") and self._whole(i + 1) is not None:
            index.append(self._whole(i + 1))
            i += 2
        return tuple(index) if index and self.tokens[i].word == "}" else ()

    def _expression(self, i: int, stops: tuple[str, ...]) -> int:
        """Walk over any expression to the first of ``stops`` outside brackets; returns the number of its token."""
        begin, operand = i, False
        stack: list[str] = []
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

    def _list(self, i: int) -> tuple[Node, int]:
        """A list of values that begins at token i: its node and the number of the token behind it."""
        kind, _, begin, end = self.tokens[i]
        if self.level == DEEPEST:
            raise self.error(begin, f"more than {DEEPEST} lists within each other")
        if kind == "list":
            return Node(self._plain_items(begin, end), None, begin, end), i + 1
        items: list[Node] = []
        self.level += 1
        while True:
            i += 1
            node, i = self._list(i) if self.tokens[i].word == "[" else self._item(i)
            items.append(node)
            if self.tokens[i].word not in (",", "]"):
                raise self.error(self.tokens[i].start, f"expected ',' or ']', found {self._found(i)}")
            if self.tokens[i].word == "]":
                self.level -= 1
                return Node(items, None, begin, self.tokens[i].end), i + 1

    def _plain_items(self, begin: int, end: int) -> list[Node]:
        """Nodes of a list of plain numbers."""
        items, at = [], begin + 1
        for part in self.text[at : end - 1].split(","):
            word = part.strip()
            start = at if len(word) == len(part) else at + part.index(word)
            items.append(_NODE((None, float(word), start, start + len(word))))
            at += len(part) + 1
        return items

    def _item(self, i: int) -> tuple[Node, int]:
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

    def _index(self, i: int) -> tuple[Index, int]:
        """Index that begins at token i: whole numbers, None for computed ones; and the number of the token behind."""
        parts: list[int | None] = []
        while not parts or self.tokens[i].word == ",":
            j = self._expression(i + 1, (",", "}"))
            parts.append(self._whole(i + 1) if j == i + 2 else None)
            i = j
        return tuple(parts), i + 1

    def _behind_index(self, i: int) -> int:
        """Number of the token behind the braces that begin at token i; 0 if they do not end in the statement."""
        depth = 0
        while self.tokens[i].word not in (";", ""):
            depth += (self.tokens[i].word == "{") - (self.tokens[i].word == "}")
            i += 1
            if depth == 0:
                return i
        return 0
