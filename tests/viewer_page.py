"""A page of the view in a real browser (headless chromium), opened from a file without any server."""

import json
import re
import time

import numpy as np

ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",  # without a graphics card it takes most of the time
]


def data_of(html):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)[1])


class Opened:
    """A page with everything that it asked for and complained about."""

    def __init__(self, browser, path, **size):
        viewport = {"width": size.pop("width", 800), "height": size.pop("height", 600)}
        self.page = browser.new_page(viewport=viewport, **size)
        self.requests, self.complaints = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(path.as_uri())
        self.wait_for("window.irbcalView !== undefined", 30)
        self.own = path.as_uri()

    def __call__(self, script):
        return self.page.evaluate(script)

    def wait_for(self, condition, seconds):
        """Look from outside: the page's own policy forbids evaluation in it."""
        until = time.monotonic() + seconds
        while not self(condition):
            assert time.monotonic() < until, f"{condition} is not true after {seconds} s: {self.complaints}"
            self.page.wait_for_timeout(50)

    def press(self, *keys):
        for key in keys:
            self.page.keyboard.press(key)

    def text(self, selector):
        return self.page.inner_text(selector)

    def matrix(self, script):
        return np.array(self(f"({script}).elements")).reshape(4, 4).T

    def check_silence(self):
        # its canvas is copied for the screen, which the browser calls slow
        assert [text for text in self.complaints if "GPU stall due to ReadPixels" not in text] == []
        assert [url for url in self.requests if not url.startswith(("data:", "blob:"))] == [self.own]
        self.page.close()


LINK = (
    "(name, k) => {irbcalView.viewer.scene.updateMatrixWorld(true);"
    "const scene = irbcalView.viewer.scene.matrixWorld.clone().invert();"
    "return scene.multiply(irbcalView.viewer.scene_tree.find(['irbcal', name, String(k)]).object.matrixWorld)}"
)


def link(page, name, k):
    return page.matrix(f"({LINK})({name!r}, {k})")


def visible(page, *path):
    return page(f"irbcalView.viewer.scene_tree.find({list(path)!r}).object.visible")
