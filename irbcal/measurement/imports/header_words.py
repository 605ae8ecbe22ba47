"""Words in the headers of tables of other programs, in several languages, and how texts are compared with them."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

import yaml

_WORDS: dict[str, list[str]] = yaml.safe_load(Path(__file__).with_name("header_words.yaml").read_text(encoding="utf-8"))


def folded(text: str) -> str:
    """Small letters without accents."""
    if text.isascii():
        return text.lower()
    text = unicodedata.normalize("NFKD", unicodedata.normalize("NFKC", text)).casefold()
    return "".join(letter for letter in text if not unicodedata.combining(letter))


def _any_of(key: str) -> re.Pattern[str]:
    """Any of some words: letters of other scripts may stand beside them, ours may not."""
    forms = [folded(word) for word in _WORDS[key]]
    latin = "|".join(re.escape(word) for word in forms if word.isascii())
    return re.compile("|".join([rf"(?<![a-z])(?:{latin})(?![a-z])", *(word for word in forms if not word.isascii())]))


QUALIFIERS = {key: _any_of(key) for key in ("deviation", "nominal", "actual")}

WORD_SETS = {key: {folded(word) for word in words} for key, words in _WORDS.items()}

UNIT_WORDS = re.compile("|".join(WORD_SETS["units"]))

KNOWN_WORDS = {word for words in _WORDS.values() for word in words if not word.isascii()}
