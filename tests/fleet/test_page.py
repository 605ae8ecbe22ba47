"""The pages load nothing, run nothing and escape what they are told."""

from dataclasses import replace

from irbcal.fleet import page


def test_the_page_of_a_list_shows_all_robots(calibrated):
    text = page.render(calibrated)
    assert "<script" not in text
    assert "<strong>Simulated.</strong>" in text
    for robot in calibrated.robots[:3]:
        assert f'<a href="{robot.id}/report.html">{robot.id}</a>' in text
        assert f"{robot.mean_mm:.3f}" in text
    assert "none.csv: there is no such file" in text
    evil = replace(calibrated, robots=(replace(calibrated.robots[0], serial="<b>&"),))
    assert "&lt;b&gt;&amp;" in page.render(evil)
    assert "Not calibrated" not in page.render(evil)
