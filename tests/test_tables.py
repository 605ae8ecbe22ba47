"""The measured tables of docs/accuracy.md and docs/speed.md are those that ``scripts/readme_tables`` makes."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
NUMBER = re.compile(r"-?\d+\.\d+")


@pytest.mark.parametrize(("name", "page"), [("levels", "accuracy"), ("pinocchio", "accuracy"), ("table_6_1", "speed")])
def test_tables_are_those_that_the_script_makes(name, page):
    """Words to the letter; numbers within 0.003 mm, because other processors round otherwise."""
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    made = "\n".join(runpy.run_path(str(ROOT / "scripts" / "readme_tables"))[name]())
    title = name.replace("table_6_1", "table 6.1")
    written = re.search(rf"<!-- {title} -->(.*?)<!-- end -->", text, re.DOTALL)[1].strip()
    assert NUMBER.sub("#", made) == NUMBER.sub("#", written)
    numbers = [np.array(NUMBER.findall(text), dtype=float) for text in (made, written)]
    assert np.abs(numbers[0] - numbers[1]).max(initial=0.0) < 0.003
