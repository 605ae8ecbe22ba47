"""Data become literals that are what they were, and nothing else, by the language's own reader."""

import ast
import re
import shutil
import subprocess

import numpy as np
import pytest
import yaml
from lxml import etree

from irbcal import literals

TEXTS = (
    "plain",
    "",
    '"""\nx\n"""',
    "'; drop",
    "\\",
    "\\\n",
    "a\x1b[31m",
    "ü€𐐀",
    "*/ x /*",
    "?" + "?/",
    "--",
    "---->",
    "\u2028",
    "\x00",
    "${x}",
    "%s",
)


def test_numbers_keep_their_last_digit():
    values = np.random.default_rng(0).standard_normal((2, 3)) * 10.0 ** np.array([-20, 0, 20])
    assert ast.literal_eval(literals.python(values.tolist())) == values.tolist()
    assert ast.literal_eval(literals.cpp(values).replace("{", "[").replace("}", "]")) == values.tolist()


def test_other_values():
    assert literals.cpp([True, 3, np.nan, -np.inf]) == "{true, 3, data::nan, -data::inf}"
    assert literals.python([True, 3, np.nan, -np.inf, None, np.float64(0.5)]) == "[True, 3, nan, -inf, None, 0.5]"
    for language in (literals.cpp, literals.python):
        with pytest.raises(TypeError, match="no literal"):
            language(object())


def test_texts_of_python():
    content = {text: [text, (text,)] for text in TEXTS}
    assert ast.literal_eval(literals.python(content)) == {text: [text, [text]] for text in TEXTS}


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
def test_texts_of_cpp(tmp_path):
    texts = [text for text in TEXTS if "\x00" not in text]
    comments = "".join(f"// {literals.comment(text)}\n/* {literals.comment(text)} */\n" for text in texts)
    lines = "".join(f"std::puts({literals.cpp(text)}); std::putchar(1);" for text in texts)
    (tmp_path / "a.cpp").write_text(f"{comments}#include <cstdio>\nint main() {{ {lines} }}\n")
    subprocess.run(["g++", "-std=c++14", "-Werror", "a.cpp", "-o", "a"], cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "a"], capture_output=True, check=True).stdout
    assert said.decode().split("\n\x01")[:-1] == texts


def test_comments():
    for text in TEXTS:
        assert not re.search(r"\n|\*/|\\", literals.comment(text))
        made = etree.tostring(etree.Comment(literals.xml_comment(text)))
        assert etree.fromstring(b"<a>%s</a>" % made)[0].tag is etree.Comment
        assert yaml.safe_load(f"a: 1 # {literals.one_line(text)}\nb: 2") == {"a": 1, "b": 2}


def test_words_are_words():
    assert literals.word("ur10_calibrated.hpp") == "ur10_calibrated.hpp"
    for text in ("", "a b", "1a", "a;b", "a\n"):
        with pytest.raises(ValueError, match="expected a name"):
            literals.word(text)


def test_a_terminal_is_shown_what_it_would_obey():
    assert literals.terminal("a\x1b[31m\x9b\r\u202e\nb") == "a\\x1b[31m\\x9b\\r\\u202e\nb"
    assert literals.terminal("plain ü") == "plain ü"
