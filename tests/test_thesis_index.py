"""From the thesis to the code: the index is complete and up to date, and its reader reads what is written."""

import runpy
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[1] / "scripts" / "thesis_index"


def test_every_kept_item_is_cited_and_the_page_is_up_to_date():
    done = subprocess.run([sys.executable, SCRIPT, "--check"], capture_output=True, text=True)
    assert done.returncode == 0, f"python scripts/thesis_index writes it anew\n{done.stderr}"


def test_citations_are_read():
    citations = runpy.run_path(str(SCRIPT))["citations"]
    text = "Nubiola 2011, eqs. 5.9, 5.10 and 5.11, section 7.5, Table A I-1, Figures 7.2 and 7.4, annex VI; eqs. 3.1 to 3.4"
    assert [item for item, _ in citations(text)] == [
        "eq. 5.9",
        "eq. 5.10",
        "eq. 5.11",
        "section 7.5",
        "Table A I-1",
        "Figure 7.2",
        "Figure 7.4",
        "annex VI",
        "eq. 3.1",
    ]
    assert [is_range for _, is_range in citations(text)][-1]
