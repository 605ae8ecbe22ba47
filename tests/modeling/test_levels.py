"""Names of the levels are those that have parameters."""

import subprocess
import sys

from irbcal.modeling import levels, parameters


def test_every_level_has_parameters_and_none_is_forgotten():
    assert set(levels.LEVELS) == {*parameters.THESIS_LEVELS, *parameters.GENERAL_LEVELS}


def test_the_names_load_nothing_heavy():
    code = "import sys, irbcal.modeling.levels; print('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"
