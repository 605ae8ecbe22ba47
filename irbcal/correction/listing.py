"""The text of a program, in one file or in several: lines, messages, and the way back into the files.

Only the bytes of numbers change. The texts of several files stand behind one another, so that a place in the text is a
place in one of the files.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple, TypeAlias

from irbcal import literals
from irbcal.errors import ProgramError

Span: TypeAlias = tuple[int, int]
"""First character of a piece of text and the one behind it."""

Edit: TypeAlias = tuple[int, int, str]
"""A span and the text that takes its place."""

BOM = "\xef\xbb\xbf"
"""The byte order mark of UTF-8, read as Latin-1."""

_MARK = re.compile(r"irbcal:? fake targets?(?:,? calibration)?(?:[ \t]+([0-9A-Za-z_.-]+))?", re.IGNORECASE)


class Number(NamedTuple):
    """A number and where it stands."""

    value: float
    start: int
    end: int


class Part(NamedTuple):
    """A file in the text."""

    name: str
    start: int
    end: int
    encoding: str = "latin-1"


class Listing:
    """The text of a program.

    Parameters
    ----------
    files : sequence of (str, bytes)
        Names and contents.
    language_name : str
        The language, for messages.
    encodings : tuple of str
        Those to try; Latin-1 comes last, reads any bytes and writes them as they were.

    Raises
    ------
    ProgramError
        If a file holds binary data.
    """

    def __init__(self, files: Sequence[tuple[str, bytes]], language_name: str, encodings: tuple[str, ...] = ()) -> None:
        self.files: list[Part] = []
        texts: list[str] = []
        start = 0
        for name, data in files:
            if b"\x00" in data:
                raise ProgramError(f"expected a program in {language_name}, found binary data", file=name)
            text, encoding = data.decode("latin-1"), "latin-1"
            for candidate in encodings:
                with suppress(UnicodeDecodeError):
                    text, encoding = data.decode(candidate), candidate
                    break
            texts.append(text)
            self.files.append(Part(name, start, start + len(text), encoding))
            start += len(text)
        self.text = "".join(texts)
        self._begins = [file.start for file in self.files]
        self._lines = []
        for file, content in zip(self.files, texts, strict=True):
            end = "\n" if "\n" in content else "\r"  # editors count no carriage return that stands alone among others
            self._lines.append([file.start, *(m.end() for m in re.finditer(end, content))])
        for lines, part in zip(self._lines, self.files, strict=True):
            lines[1:] = [part.start + end for end in lines[1:]]

    def file_at(self, position: int) -> int:
        """Number of the file of a place."""
        return max(0, bisect.bisect_right(self._begins, position) - 1)

    def line(self, position: int) -> int:
        """Line of a place in its file, from 1."""
        return bisect.bisect_right(self._lines[self.file_at(position)], position)

    def column(self, position: int) -> int:
        """Column of a place, from 1."""
        return position - self._lines[self.file_at(position)][self.line(position) - 1] + 1

    def error(self, position: int, message: str) -> ProgramError:
        """A refusal that names file and line."""
        return ProgramError(message, file=self.files[self.file_at(position)].name, line=self.line(position))

    def quote(self, start: int, end: int) -> str:
        """A piece of the program for a message: one printable line, not long."""
        return quoted(self.text[start:end])

    def quote_line(self, position: int) -> str:
        """The line of a place, for a message."""
        lines = self._lines[self.file_at(position)]
        return self.quote(lines[self.line(position) - 1], self.after_line(position))

    def newline(self, file: int = 0) -> str:
        """The line end of a file."""
        text = self.text[self.files[file].start : self.files[file].end]
        match = re.search(r"\r?\n", text)
        return match[0] if match else "\r" if "\r" in text else "\n"

    def after_line(self, position: int) -> int:
        """Where the line behind the one of a place begins, or the end of its file."""
        file = self.files[self.file_at(position)]
        lines = self._lines[self.file_at(position)]
        k = self.line(position)
        return lines[k] if k < len(lines) else file.end

    def files_with(self, edits: Iterable[Edit]) -> dict[str, bytes]:
        """Contents of the files with edits, by their names."""
        sorted_edits = sorted(edits)
        out = {}
        for number, file in enumerate(self.files):
            pieces: list[str] = []
            end = file.start
            for start, stop, new in sorted_edits:
                inside = max(start, stop - 1) if stop > start else max(0, start - 1)
                is_part = self.file_at(inside) == number or start == 0  # a place between two files belongs to the first
                if file.start <= start and stop <= file.end and is_part:
                    pieces += [self.text[end:start], new]
                    end = stop
            out[file.name] = "".join([*pieces, self.text[end : file.end]]).encode(file.encoding)
        return out


def quoted(text: str) -> str:
    """A piece of a program for a message: in its encoding, on one printable line, not long."""
    with suppress(UnicodeDecodeError, UnicodeEncodeError):
        text = text.encode("latin-1").decode("utf-8")
    text = literals.one_line(text)
    return text if len(text) <= 50 else text[:49] + "…"


def one_word(fingerprint: str) -> str:
    """A fingerprint that may stand in a comment.

    Raises
    ------
    ValueError
        If it is not one printable word, and so might end the comment.
    """
    if not fingerprint.isascii() or not fingerprint.isprintable() or fingerprint.split() != [fingerprint]:
        raise ValueError("expected a fingerprint of one word")
    return fingerprint


def mark_in(comments: Iterable[str]) -> str | None:
    """Fingerprint in the first mark among comments; empty where it names none, None without mark."""
    for comment in comments:
        match = _MARK.search(comment)
        if match:
            return match[1] or ""
    return None


def joined_comments(comments: Iterable[str], signs: str) -> list[str]:
    """Comments as one, without their signs: the second line of a mark bears the fingerprint."""
    return [" ".join(text.strip(signs) for text in comments)]


def up_to_next(heads: Sequence[re.Match[str]], end: int) -> Iterator[tuple[re.Match[str], int]]:
    """Headings of a text, each with the place where the next one begins; ``end``: of the text."""
    return zip(heads, [*(behind.start() for behind in heads[1:]), end], strict=False)


def number_like(old: str, value: float, fewest: int) -> str:
    """A number with as many decimals as the text that it replaces, ``fewest`` at least; without exponent."""
    digits = re.match(r"[-+ \t]*\d*(?:\.(\d*))?", old)
    decimals = max(fewest, len(digits[1] or "") if digits else 0)
    text = f"{value:.{min(decimals, 17)}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


class Token(NamedTuple):
    """A word of a program."""

    kind: str
    """As the language's reader calls it: ``number``, ``name``, ``symbol`` …"""
    word: str
    """As it stands there; names in lower case where the language does not mind."""
    start: int
    end: int
    """Place in the text."""


Tokens = Sequence[Token]


def between_commas(tokens: Tokens) -> list[Tokens]:
    """Tokens between commas that stand in no brackets, up to the bracket that closes those around them."""
    out: list[Tokens] = []
    depth, begin = 0, 0
    for k, token in enumerate(tokens):
        depth += (token.word in ("(", "[", "{")) - (token.word in (")", "]", "}"))
        if depth < 0:
            return [*out, tokens[begin:k]]
        if depth == 0 and token.word == ",":
            out.append(tokens[begin:k])
            begin = k + 1
    return [*out, tokens[begin:]]


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
