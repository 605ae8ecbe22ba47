"""Parts of sentences: numbers with their nouns, and lists that are cut short."""

from __future__ import annotations

from collections.abc import Sequence


def inflected(n: int, singular: str, plural: str = "") -> str:
    """The form of a noun or verb for a number; the plural has an s at its end, unless it is given."""
    return singular if n == 1 else plural or f"{singular}s"


def counted(n: int, singular: str, plural: str = "") -> str:
    """A number and its noun, see `inflected`."""
    return f"{n} {inflected(n, singular, plural)}"


def and_more(n: int) -> str:
    """What follows an example of which there are n others."""
    return f" and {n} more" if n else ""


def first_of(names: Sequence[str], most: int | None) -> str:
    """Names with commas between them: so many, and how many more there are; None for all."""
    more = len(names) - len(names[:most])
    return ", ".join(names[:most]) + (f" …{and_more(more)}" if more else "")


def joined(words: Sequence[str]) -> str:
    """Words with commas between them, and "and" before the last."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))
