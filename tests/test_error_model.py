"""docs/error-model.md says what the code does: its tables, its example, the files that it names."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "error-model.md").read_text(encoding="utf-8")


def test_its_tables_are_those_of_the_code():
    done = subprocess.run([sys.executable, ROOT / "scripts" / "error_model", "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_its_example_runs_and_prints_what_it_says(capsys):
    (example,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    names = {}
    exec(example, names)
    text = capsys.readouterr().out
    assert "Error models compared by their evidence" in text
    said = float(re.search(r"prints a held-out mean of (\d\.\d+) mm", TEXT)[1])
    assert abs(1e3 * names["error"].mean() - said) < 0.003
    assert names["inside"].mean() > 0.93
    assert not names["fit"].average.gears
    # what it is compared with
    from irbcal.identification.fit import identify
    from irbcal.measurement.points import distances

    level = identify(names["arm"], names["points"].select(names["first"]), "34")
    said = float(re.search(r"level 34 reaches (\d\.\d+) mm", TEXT)[1])
    assert abs(1e3 * distances(level.robot, names["rest"]).mean() - said) < 0.003


def test_files_that_it_names_exist():
    named = re.findall(r"`((?:irbcal|tests|scripts)/[\w/.]+)`", TEXT)
    assert len(named) > 4
    for path in [*named, *re.findall(r"(?:python|pytest) ((?:scripts|tests)/[\w/.]+)", TEXT)]:
        assert (ROOT / path).exists(), path
