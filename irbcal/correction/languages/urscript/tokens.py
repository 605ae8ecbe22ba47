"""Tokens of URScript, statement by statement."""

from __future__ import annotations

import re

from irbcal.correction.listing import BOM, Listing
from irbcal.correction.tokens import Token, Tokens

TOKEN = re.compile(
    r"""(?P<space>[ \t\f\v]+)
    |(?P<comment>\#[^\r\n]*)
    |(?P<newline>\r\n|\n|\r|;)
    |(?P<string>"[^"\r\n]*"|'[^'\r\n]*')
    |(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z_]))
    |(?P<name>[A-Za-z_\x80-\xff][\w\x80-\xff]*)
    |(?P<symbol>==|!=|<=|>=|[-+*/=<>()\[\]{},:.%&|^~?@!])
    |(?P<line>\$[^\r\n]*)
    |(?P<other>.)""",
    re.VERBOSE | re.DOTALL,
)
_MOST = 10_000  # tokens of a statement


def statements(listing: Listing) -> tuple[list[list[Token]], list[str]]:
    """Statements, each to the end of its line or of its brackets, and the comments.

    Raises
    ------
    ProgramError
        If a string or a bracket is not closed.
    """
    out: list[list[Token]] = []
    comments: list[str] = []
    tokens: list[Token] = []
    depth = 0
    start = len(BOM) if listing.text.startswith(BOM) else 0
    for found in TOKEN.finditer(listing.text, start):
        kind = str(found.lastgroup)
        if kind == "comment":
            comments.append(found[0])
        elif kind == "newline":
            if tokens and (depth <= 0 or found[0] == ";"):
                out.append(tokens)
                tokens, depth = [], 0
        elif kind == "other" and found[0] in "\"'":
            raise listing.error(found.start(), "the string is not closed in its line")
        elif kind not in ("space", "line"):
            depth += (found[0] in "([") - (found[0] in ")]") if kind == "symbol" else 0
            tokens.append(Token(kind, found[0], found.start(), found.end()))
            if len(tokens) > _MOST:
                raise listing.error(tokens[0].start, "the brackets of this statement are not closed")
    if tokens:
        if depth > 0:
            raise listing.error(tokens[0].start, "the brackets of this statement are not closed")
        out.append(tokens)
    return out, comments


def arguments(tokens: Tokens) -> list[tuple[str, Tokens]]:
    """Arguments of a call whose tokens begin with ``(``, each with its name or an empty text; what follows is left."""
    out: list[tuple[str, Tokens]] = []
    depth, begin = 0, 1
    for k, token in enumerate(tokens):
        depth += (token.word in ("(", "[")) - (token.word in (")", "]")) if token.kind == "symbol" else 0
        if (depth == 1 and token.word == ",") or depth == 0:
            piece = tokens[begin:k]
            if len(piece) > 2 and piece[0].kind == "name" and piece[1].word == "=":
                out.append((piece[0].word, piece[2:]))
            elif piece:
                out.append(("", piece))
            begin = k + 1
        if depth == 0:
            break
    return out
