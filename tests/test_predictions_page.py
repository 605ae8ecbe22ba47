"""docs/predictions.md says what the code does: its examples run, its commands and files exist."""

import re
from pathlib import Path

import numpy as np
import pandas as pd

import irbcal

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "predictions.md").read_text(encoding="utf-8")


def test_its_examples_run_and_its_commands(tmp_path, monkeypatch, capsys, program):
    monkeypatch.chdir(tmp_path)
    names = {}
    first, second = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    exec(first, names)
    printed = capsys.readouterr().out
    assert "x_u95_mm" in printed
    assert names["seen"].interval.shape == (2, 3)
    exec(second, names)
    np.testing.assert_array_equal(names["C"], irbcal.load("my-robot").record.covariance_matrix())

    q = pd.DataFrame(np.degrees(names["q"]), columns=[f"q{k}_deg" for k in range(1, 7)])
    q.to_csv("joints.csv", index=False)
    irbcal.simulate("irb1600", random=20, seed=4).to_frame().to_csv("verification.csv", index=False)
    for line in re.findall(r"^irbcal (.*?)  +#", TEXT, re.MULTILINE):
        told = program(*line.split())
        assert "u95_mm" in told or "intervals" in told
    assert "x_mm,y_mm,z_mm,x_u95_mm,y_u95_mm,z_u95_mm,outside" in program(
        "fk", "my-robot", "--joints", "joints.csv", "--target", "smr1", "--intervals"
    )


def test_files_that_it_names_exist():
    for path in re.findall(r"\b((?:irbcal|tests|docs)/[\w/]+\.\w+)", TEXT):
        assert (ROOT / path).exists(), path
