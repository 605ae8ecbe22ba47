"""Names of options: the same as those that the code knows, and cheap to read."""

import subprocess
import sys

import pytest

from irbcal.errors import OptionError
from irbcal.identification import choices, minimax, robust
from irbcal.modeling import parameters


def test_names_are_those_of_the_code():
    assert set(choices.LEVELS) == {*parameters.THESIS_LEVELS, *parameters.GENERAL_LEVELS}
    assert (*choices.LEVELS, "auto", "best-level") == choices.MODELS
    assert ("linear", *robust.LOSSES) == choices.LOSSES
    assert tuple(minimax.SOLVERS) == ("numpy", "clarabel")
    assert choices.METHODS == ("least-squares", "circles", "nelder-mead")


def test_an_alias_is_understood():
    assert choices.method_of("axes") == choices.method_of("circles") == "circles"


def test_what_is_not_a_choice_is_refused_with_its_name():
    assert choices.checked("loss", "huber", choices.LOSSES) == "huber"
    with pytest.raises(OptionError, match="loss: expected linear, soft_l1 or huber, found 'l2'") as caught:
        choices.checked("loss", "l2", choices.LOSSES)
    assert caught.value.parameter == "loss"


def test_reading_them_imports_nothing_heavy():
    code = "import sys, irbcal.identification.choices; print(*(m for m in ('numpy', 'scipy', 'pandas') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
