"""Reports and certificates in other languages: all is said, numbers and names stay, and what is unknown is marked."""

import html
import re
from collections import Counter
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import polib
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import OptionError
from irbcal.io import robots
from irbcal.reports import certificate, report_page
from irbcal.reports.languages import LANGUAGES
from irbcal.reports.translated_pages import translated
from irbcal.units import MM

OTHERS = [language for language in LANGUAGES if language != "en"]
PLACE = re.compile(r"\{[a-z]+\d*\}")
BETWEEN = re.compile(r'"\s*f?"')
"""Between two parts of a text that goes on in the next line."""
PACKAGE = Path(irbcal.__file__).parent


class Texts(HTMLParser):
    """Texts of a page that may change, those that must not, and its tags."""

    def __init__(self, page):
        super().__init__()
        self.said, self.fixed, self.tags, self.english, self.open = [], [], [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        if tag not in ("br", "meta"):
            self.open.append(
                (
                    tag,
                    ("translate", "no") in attrs or tag in ("code", "pre", "style"),
                    tag == "span" and ("lang", "en") in attrs,
                )
            )
        if not self.open[-1][2]:
            self.tags.append((tag, [pair for pair in attrs if pair[0] not in ("lang", "aria-label", "data-words")]))

    def handle_endtag(self, tag):
        self.open.pop()

    def handle_data(self, data):
        text = " ".join(data.split())
        if not text:
            return
        if any(fixed for _, fixed, _ in self.open):
            self.fixed.append(text)
        else:
            self.said.append(text)
            if self.open[-1][2]:
                self.english.append(text)


@pytest.fixture(scope="module")
def pages(demo_calibration, page):
    """A report of a level, one of model auto, and certificates that pass, do not, and judge nothing."""
    proof = robots.demo_file("demo_verification.csv")
    out = [page, report_page.render(irbcal.load(demo_calibration).record)]
    for options in ({"tolerance": 1.1 * MM}, {"tolerance": 0.05 * MM, "rule": "max"}, {}):
        out.append(certificate.render(irbcal.evaluate(demo_calibration, proof, **options)))
    return out


@pytest.fixture(scope="module")
def english(pages):
    return [Texts(page) for page in pages]


@pytest.mark.parametrize("language", OTHERS)
def test_everything_is_said_and_numbers_and_names_stay(pages, english, language):
    for page, before in zip(pages, english, strict=True):
        other = translated(page, language)
        assert f'<html lang="{language}"' in other
        after = Texts(other)
        assert after.english == []
        assert sorted(after.fixed) == sorted(before.fixed)
        assert sorted(after.tags, key=repr) == sorted(before.tags, key=repr)
        assert not numbers(before.said) - numbers(after.said)
        assert all(len(more) == 1 for more in numbers(after.said) - numbers(before.said))  # Japanese counts by digits
        words = [text for text in before.said if re.search(r"[a-z]{4}.* .*[a-z]{4}", text)]
        assert set(words) & set(after.said) == set()


def numbers(texts):
    return Counter(re.findall(r"\d+(?:\.\d+)?", " ".join(texts)))


def test_each_message_has_a_translation_with_the_same_places():
    messages = {}
    for language in OTHERS:
        entries = polib.pofile(str(files("irbcal.reports") / "locale" / f"{language}.po"))
        messages[language] = [entry.msgid for entry in entries]
        for entry in entries:
            assert entry.msgstr, (language, entry.msgid)
            assert sorted(PLACE.findall(entry.msgid)) == sorted(set(PLACE.findall(entry.msgstr))), entry.msgid
        verdicts = [entries.find(word).msgstr for word in ("PASS", "FAIL", "NOT PROVEN", "NO TOLERANCE")]
        assert len(set(verdicts)) == 4
    assert len({tuple(ids) for ids in messages.values()}) == 1
    assert len(messages["de"]) == len(set(messages["de"]))


def test_each_message_is_said_somewhere():
    """Word triples of long messages stand in the package: a sentence that was changed there shows here."""
    said = set()
    for path in PACKAGE.rglob("*.py"):
        said |= triples(BETWEEN.sub("", path.read_text("utf-8")))
    for path in (PACKAGE / "reports" / "templates").glob("*.j2"):
        page = path.read_text("utf-8")
        said |= triples(page) | triples(re.sub(r"\{\{.*?\}\}|\{%.*?%\}|<[^>]+>", " ", page))
    lost = []
    for entry in polib.pofile(str(files("irbcal.reports") / "locale" / "de.po")):
        wanted = set().union(*(triples(part) for part in PLACE.split(entry.msgid)))
        if len(wanted) >= 4 and len(wanted & said) < 0.6 * len(wanted):
            lost.append(entry.msgid)
    assert lost == []


def triples(text):
    words = re.findall(r"[a-z\u2019']+", text.lower())
    return set(zip(words, words[1:], words[2:], strict=False))


def test_names_that_look_like_messages_stay(demo_calibration):
    proof = robots.demo_file("demo_verification.csv")
    info = {"operator": "PASS", "serial": "nominal robot"}
    page = certificate.render(irbcal.evaluate(demo_calibration, proof, tolerance=1.1 * MM, info=info))
    fixed = Texts(translated(page, "de")).fixed
    assert {"PASS", "nominal robot"} <= set(fixed)


def page_of(body):
    return f'<!DOCTYPE html>\n<html lang="en"><body>{body}</body></html>'


def test_code_and_the_sentence_after_a_name_are_no_part_of_a_message():
    sentences = "Calibrated with irbcal 1.0, evaluated with irbcal 2.0. Nothing: every measured point was used."
    body = translated(page_of(f"<p>{sentences} <code>Signature</code></p>"), "de").partition("<body>")[2]
    assert "ausgewertet mit irbcal 2.0. Nichts: Jeder Messpunkt wurde benutzt. <code>Signature</code>" in body


def test_what_is_unknown_stays_english_and_says_so():
    page = page_of("<p>Nothing: every measured point was used. A sentence of tomorrow.</p>")
    other = translated(page, "fr")
    assert '<span lang="en">Rien : chaque point mesuré a été utilisé. A sentence of tomorrow.</span>' in other
    with pytest.raises(OptionError, match="language"):
        translated(page, "it")
    assert translated(page, "en") == page


@settings(max_examples=20, derandomize=True)
@given(st.lists(st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Co"]), max_size=20), max_size=5))
def test_any_text_survives(texts):
    body = "".join(f"<p>{html.escape(text)} <code>{html.escape(text)}</code></p>" for text in texts)
    assert "".join(Texts(translated(page_of(body), "ja")).fixed) == "".join(Texts(page_of(body)).fixed)


def test_from_the_command_line(demo_calibration, tmp_path):
    call = ["evaluate", str(demo_calibration), str(robots.demo_file("demo_verification.csv")), "--tolerance", "1.1"]
    done = CliRunner().invoke(app, [*call, "--report", str(tmp_path / "c.html"), "--language", "de"])
    assert done.exit_code == 0, done.output
    assert ">BESTANDEN<" in (tmp_path / "c.html").read_text("utf-8")
    assert CliRunner().invoke(app, [*call, "--report", str(tmp_path / "d.html"), "--language", "it"]).exit_code != 0
    assert CliRunner().invoke(app, [*call, "--language", "de"]).exit_code != 0
    assert [path.name for path in tmp_path.iterdir()] == ["c.html"]


def test_a_message_whose_places_hold_unknown_words_is_none():
    """A caption with a comma more would else be taken for another one, and stay English within."""
    caption = "Position errors of the measured poses over the workspace, calibrated, from above"
    assert "lang" not in translated(page_of(f"<p>{caption}</p>"), "fr").partition("<body>")[2]
    assert '<span lang="en">' in translated(page_of(f"<p>{caption.replace('calibrated', 'tomorrow')}</p>"), "fr")
