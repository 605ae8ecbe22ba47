"""The report in a real browser (headless chromium), opened from a file."""

import numpy as np
import pytest
from support import arm, measured, random_robot, write_measurements

import irbcal

HOSTILE = "</title><script>window.hacked=1</script><img src=x onerror=window.hacked=2>"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """The report of a calibration whose groups have a hostile name."""
    folder, nominal, rng = tmp_path_factory.mktemp("page"), arm(), np.random.default_rng(1)
    points = measured(random_robot(nominal, "26", rng), nominal.random_joints(60, 1), 3e-5, rng)
    file = write_measurements(folder / "m.csv", points)
    lines = file.read_text().splitlines()
    file.write_text("\n".join([f"{lines[0]},group", *(f"{line},{HOSTILE}" for line in lines[1:])]) + "\n")
    irbcal.save(irbcal.calibrate(file, "irb1600", "26", holdout=0.5), folder / "out")
    return folder / "out" / "report.html"


class Opened:
    """A page with everything that it asked for and complained about."""

    def __init__(self, browser, path, width=1400, scheme="light"):
        self.page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.requests, self.complaints = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(path.as_uri())

    def __call__(self, script):
        return self.page.evaluate(script)


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (400, "dark")])
def test_it_opens_quietly_and_fits(browser, path, width, scheme):
    shown = Opened(browser, path, width, scheme)
    assert shown.requests == [path.as_uri()]
    assert shown.complaints == []
    assert shown("window.hacked") is None
    assert HOSTILE in shown("document.body.textContent")
    assert shown("document.documentElement.scrollWidth") <= width
    smallest = shown(
        """Math.min(...[...document.querySelectorAll("svg[role=img] text")].map(
             t => parseFloat(t.getAttribute("font-size")) * t.ownerSVGElement.getBoundingClientRect().width
                  / t.ownerSVGElement.viewBox.baseVal.width))"""
    )
    assert smallest >= 9  # pixels
    light = shown("getComputedStyle(document.body).backgroundColor.match(/[0-9]+/g).map(Number)")
    assert (np.mean(light) > 128) == (scheme == "light")
    bars = shown("""[...document.querySelectorAll("#errors svg[role=img] rect")].map(r => getComputedStyle(r).fill)""")
    assert bars == ["rgb(31, 114, 189)", "rgb(221, 125, 17)"]  # calibrated and nominal, on light and on dark


def test_no_text_of_a_drawing_leaves_it_or_covers_another(browser, path):
    shown = Opened(browser, path, 1400)
    assert (
        shown(
            """[...document.querySelectorAll("svg[role=img]")].flatMap(svg => {
             const frame = svg.getBoundingClientRect();
             const boxes = [...svg.querySelectorAll("text")].map(t => [t.textContent, t.getBoundingClientRect()]);
             const out = boxes.filter(([, b]) => b.left < frame.left - 1 || b.right > frame.right + 1
               || b.top < frame.top - 1 || b.bottom > frame.bottom + 1).map(([t]) => "leaves: " + t);
             boxes.forEach(([t, a], i) => boxes.slice(i + 1).forEach(([u, b]) => {
               if (a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 4 && b.top < a.bottom - 4)
                 out.push("covers: " + t + " / " + u);
             }));
             return out;
           })"""
        )
        == []
    )


def test_the_policy_refuses_what_does_not_belong_there(browser, path, tmp_path):
    """The control: with a script and a picture added, the browser complains and neither works."""
    changed = tmp_path / "changed.html"
    added = "<script>window.hacked=3</script><img src='https://example.invalid/x.png'></body>"
    changed.write_text(path.read_text(encoding="utf-8").replace("</body>", added), encoding="utf-8")
    shown = Opened(browser, changed)
    assert len(shown.complaints) >= 2
    assert shown("window.hacked") is None


def test_what_a_mark_is_shows_on_the_pointer(browser, path):
    shown = Opened(browser, path)
    mark = shown.page.locator("#poses .marks circle").first
    title = mark.locator("title").text_content()
    assert title.startswith("pose ")
    mark.scroll_into_view_if_needed()
    box = mark.bounding_box()
    at = f"document.elementFromPoint({box['x'] + box['width'] / 2}, {box['y'] + box['height'] / 2})"
    assert shown(f"{at}.querySelector('title').textContent").startswith("pose ")


def test_it_prints_on_few_pages(browser, path):
    shown = Opened(browser, path)
    shown.page.emulate_media(media="print")
    assert shown("getComputedStyle(document.querySelector('nav')).display") == "none"
    pdf = shown.page.pdf(format="A4")
    assert pdf.startswith(b"%PDF")
    assert 4 <= pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page/") + pdf.count(b"/Type/Page/") <= 14
