"""The page of a study: self-contained, escaped, with all figures that the rows allow."""

import re

import pytest

from irbcal.errors import IrbcalError
from irbcal.studies import folder
from irbcal.studies.figures import drawn, figures
from irbcal.studies.page import render, verdict
from irbcal.studies.results import Results, Table


def test_the_page_loads_nothing_runs_nothing_and_escapes(done, results, tables, tmp_path):
    (tmp_path / "parts").mkdir()
    wanted = drawn(results)
    for r in wanted:
        (tmp_path / "parts" / f"{r.name}.npz").write_bytes(done[r][1])
    series = {r: folder.read_series(tmp_path, r) for r in wanted}
    hostile = Table("x", "<script>alert(1)</script>", ("a",), (('"><img src=http://x>',),), ("<b>note</b>",))
    page = render(results, [*tables.values(), hostile], series)
    assert "default-src 'none'" in page
    assert "<strong>Simulated.</strong>" in page
    assert "<script" not in page
    assert "<img" not in page
    assert "<b>note" not in page
    assert "&lt;script&gt;" in page
    links = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)""", page) + re.findall(r"url\(([^)]*)\)", page)
    assert links
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
    assert page.count("<figure>") == len([f for f in figures(results) if results.has(*f.needs)]) == 20
    assert page.count("<h3>") == len(tables) + 1
    ids = re.findall(r'\sid="([^"]*)"', page)
    assert len(ids) == len(set(ids))
    assert "0.272" in page  # the thesis's, Table 7.4
    (tmp_path / "parts" / f"{wanted[0].name}.npz").write_bytes(b"PK\x03\x04 not an archive")
    with pytest.raises(IrbcalError, match=r"damaged: delete it and nominal\.csv"):
        folder.read_series(tmp_path, wanted[0])


def test_the_verdict_waits_for_all_procedures(results):
    assert verdict(results).startswith("4 simulated calibrations by least-squares: with fake targets the virtual robot")
    some = Results(results.frame[results.frame["repetition"] != "34-120-2"], results.settings)
    assert verdict(some) is None
