"""Reports and certificates in other languages: what a finished English page says, sentence by sentence.

Notes and doubts stand in ``calibration.json`` as English sentences, whichever version wrote them; so a page is written
in English, and then its texts are looked up in a catalogue (``locale/de.po`` and its like, edited with any gettext
editor). A message may hold places: ``{n}`` a number, ``{name…}`` a name that stays as it is, and any other a part that
is itself looked up. Numbers, names from data, code and everything between tags stay as they are. A text that the
catalogue does not know stays English, marked as such.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape, unescape
from html.parser import HTMLParser
from importlib.resources import files

from irbcal.option_values import checked
from irbcal.reports.languages import LANGUAGES, PageLanguage

INLINE = frozenset(["a", "abbr", "b", "code", "em", "small", "span", "strong", "sub", "sup", "time"])
"""Elements that stand in the midst of a sentence."""
VOID = frozenset(["br", "col", "hr", "img", "input", "link", "meta", "wbr"])
UNTRANSLATED = frozenset(["code", "pre", "script", "style"])
"""Elements whose content no language changes."""
BARE = frozenset(("svg", "title"))
"""Elements in which no others may stand."""
SPOKEN = re.compile(r'(\s(?:aria-label|data-words)=")([^"]*)(")')
"""Attributes that are read to people."""
PLACEHOLDER = re.compile(r"\{([a-z]+)\d*\}")
NUMBER = r"([+\-\u2212±<]?\s?\d[\d.,]*(?:e[+\-]?\d+)?\s?%?)"
SENTENCES = re.compile(r"(?<=[.!?])\s+(?=\S)")
WORD = re.compile(r"(?<![\w./])[A-Za-z]{3,}(?![\w./(])|^(?:no|.*\bto\b.*)$")
"""What a text without words to look up does not have: names such as q1_deg, smr1 or tool.urdf are none."""
EASTERN = frozenset(("ja", "zh"))
"""Languages without spaces between sentences."""
EASTERN_MARKS = {".": "\u3002", ":": "\uff1a", ";": "\uff1b"}
TOKEN = 0xE000
"""First of the characters that stand for an element in the midst of a sentence."""


@dataclass(frozen=True)
class Message:
    """A message with places."""

    expression: re.Pattern[str]
    """Of the English message."""
    translation: str
    """The other language's, with the same places."""
    placeholders: tuple[str, ...]
    """In the order of the English message."""
    longest: str
    """The longest text between places, by which most candidates are ruled out at once."""


@dataclass(frozen=True)
class Catalogue:
    """Messages of a language."""

    language: str
    plain: Mapping[str, str]
    patterns: Sequence[Message]
    """Those that say most come first."""

    def say(self, text: str) -> tuple[str, bool]:
        """A text in this language, sentence by sentence where it is not known as a whole; and whether all of it is."""
        if not WORD.search(text):
            return text, True
        whole = self._ended(text)
        if whole is not None:
            return whole, True
        sentences = [(sentence, self._ended(sentence)) for sentence in SENTENCES.split(text)]
        gap = "" if self.language in EASTERN else " "
        known = all(translation is not None for _, translation in sentences)
        return gap.join(sentence if translation is None else translation for sentence, translation in sentences), known

    def _ended(self, text: str) -> str | None:
        """A sentence, or a caption that a full stop or a colon was put behind."""
        translation = self._message(text) or self._members(text)
        if translation is None and text[-1] in EASTERN_MARKS:
            translation = self._message(text[:-1].rstrip())
            if translation is not None:
                translation += EASTERN_MARKS[text[-1]] if self.language in EASTERN else text[-1]
        return translation

    def _message(self, text: str) -> str | None:
        """The whole text as one message; None where the catalogue does not know it, or what stands in its places."""
        if text in self.plain:
            return self.plain[text]
        for message in self.patterns:
            match = message.expression.fullmatch(text) if message.longest in text else None
            if match is not None and not any(SENTENCES.search(text_there) for text_there in match.groups()):
                translated = [
                    self._part(placeholder, text_there)
                    for placeholder, text_there in zip(message.placeholders, match.groups(), strict=True)
                ]
                if None not in translated:
                    names = (placeholder[1:-1] for placeholder in message.placeholders)
                    return message.translation.format_map(dict(zip(names, translated, strict=True)))
        return None

    def _part(self, place: str, text: str) -> str | None:
        """What stands in a place: a number or a name as it is, else a list by its members, or a message."""
        if PLACEHOLDER.sub(r"\1", place) in ("n", "name") or not WORD.search(text):
            return text
        return self._members(text) or self._message(text)

    def _members(self, text: str) -> str | None:
        """A list by its members; None where one of them is not known."""
        translation = [self._message(member) if WORD.search(member) else member for member in text.split(", ")]
        return None if None in translation else ", ".join(map(str, translation))


@cache
def catalogue(language: PageLanguage) -> Catalogue:
    """The messages of a language."""
    import polib

    source = files("irbcal.reports") / "locale" / f"{language}.po"
    plain: dict[str, str] = {}
    patterns: list[Message] = []
    for entry in polib.pofile(source.read_text("utf-8"), encoding="utf-8"):
        placeholders = tuple(match.group() for match in PLACEHOLDER.finditer(entry.msgid))
        if not entry.msgstr:
            continue
        if not placeholders:
            plain[entry.msgid] = entry.msgstr
            continue
        texts = PLACEHOLDER.split(entry.msgid)[::2]
        expression = re.escape(texts[0])
        for place, text in zip(placeholders, texts[1:], strict=True):
            expression += (NUMBER if PLACEHOLDER.sub(r"\1", place) == "n" else "(.+?)") + re.escape(text)
        patterns.append(Message(re.compile(expression), entry.msgstr, placeholders, max(texts, key=len)))
    patterns.sort(key=lambda message: -len(message.expression.pattern))
    return Catalogue(language, plain, patterns)


@dataclass
class Inline:
    """An element in the midst of a sentence: its tags as they stand, and what is between them."""

    start: str
    content: list[str | Inline]
    end: str = ""
    untranslated: bool = False


class _PageTranslator(HTMLParser):
    """A page written again as it is read; all that is no text stays as it stands.

    A block is what stands between two tags that are no `INLINE` ones: its texts, and the elements among them.
    """

    def __init__(self, messages: Catalogue) -> None:
        super().__init__(convert_charrefs=False)
        self.messages = messages
        self.out: list[str] = []
        self.block = [Inline("", [])]
        """The block, and the elements that are open in it."""
        self.untranslated: list[str] = []
        """Open elements of which no text is changed, the outermost first."""
        self.bare = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        raw = SPOKEN.sub(self._attribute, self.get_starttag_text() or "")
        if tag == "html":
            raw = re.sub(r'lang="[^"]*"', f'lang="{self.messages.language}"', raw)
        self.bare += tag in BARE
        if tag in INLINE:
            untranslated = bool(self.untranslated) or tag in UNTRANSLATED or ("translate", "no") in attrs
            self.block.append(Inline(raw, [], untranslated=untranslated))
        else:
            self._close()
            self.out.append(raw)
            untranslated = tag in UNTRANSLATED or ("translate", "no") in attrs
        if (self.untranslated or untranslated) and tag not in VOID:
            self.untranslated.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._close()
        self.out.append(self.get_starttag_text() or "")

    def handle_endtag(self, tag: str) -> None:
        if tag in INLINE and len(self.block) > 1:
            element = self.block.pop()
            element.end = f"</{tag}>"
            self.block[-1].content.append(element)
        else:
            self._close()
            self.out.append(f"</{tag}>")
        self.bare -= tag in BARE
        if self.untranslated:
            self.untranslated.pop()

    def handle_data(self, data: str) -> None:
        self.block[-1].content.append(data)

    def handle_entityref(self, name: str) -> None:
        self.block[-1].content.append(f"&{name};")

    def handle_charref(self, name: str) -> None:
        self.block[-1].content.append(f"&#{name};")

    def handle_decl(self, decl: str) -> None:
        self.out.append(f"<!{decl}>")

    def close(self) -> None:
        super().close()
        self._close()

    def _attribute(self, match: re.Match[str]) -> str:
        return match.group(1) + escape(self.messages.say(unescape(match.group(2)))[0]) + match.group(3)

    def _close(self) -> None:
        """Write the block."""
        while len(self.block) > 1:
            element = self.block.pop()
            self.block[-1].content.append(element)
        self.out.append(self._said(self.block[0].content, bool(self.untranslated)))
        self.block = [Inline("", [])]

    def _said(self, fragments: Sequence[str | Inline], kept: bool) -> str:
        """Texts in the other language; elements among them stand for themselves in the sentence."""
        elements = [fragment for fragment in fragments if isinstance(fragment, Inline)]
        inner = [
            element.start + self._said(element.content, element.untranslated) + element.end for element in elements
        ]
        if kept:
            following = iter(inner)
            return "".join(fragment if isinstance(fragment, str) else next(following) for fragment in fragments)
        tokens = [chr(TOKEN + k) for k in range(len(elements))]
        following = iter(tokens)
        text = "".join(unescape(fragment) if isinstance(fragment, str) else next(following) for fragment in fragments)
        core = text.strip(" \n\t\xa0" + "".join(tokens))
        before, _, after = text.partition(core) if core else (text, "", "")
        sentence, known = self.messages.say(" ".join(core.split()))
        sentence = escape(sentence, quote=False)
        sentence = (
            escape(before) + (sentence if known or self.bare else f'<span lang="en">{sentence}</span>') + escape(after)
        )
        for token, element in zip(tokens, inner, strict=True):
            sentence = sentence.replace(token, element)
        return sentence


def translated(page: str, language: PageLanguage) -> str:
    """A page of this room in another language.

    Parameters
    ----------
    page : str
        In English, as HTML.
    language : {"en", "de", "fr", "ja", "zh"}

    Raises
    ------
    OptionError
        If there is no catalogue of that language.
    """
    if checked("language", language, LANGUAGES) == "en":
        return page
    writer = _PageTranslator(catalogue(language))
    writer.feed(page)
    writer.close()
    return "".join(writer.out)
