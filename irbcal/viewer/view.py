"""A calibrated robot or a plan to look at: its page in a browser or a notebook, and who serves it.

Other users of this computer and pages of other sites can reach the port, too: the address has a random part that they
do not know, and whoever asks for anything else gets nothing.

::

    import irbcal

    view = irbcal.view("my-robot", "verification.csv")
    view                       # in a notebook: shows itself
    view.save("view.html")     # one self-contained page for a colleague
    view.serve(open=True)      # in a browser on this computer
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.errors import IrbcalError
from irbcal.summary import Paragraph, Result, remarks, values
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd

    from irbcal.viewer.scene import PageScene, WhichModel


ADDRESS = "127.0.0.1"
PORT = 8160
"""Tried first, so that a tunnel's command stays the same."""

TOKEN_BYTES = 16
"""Of the random part of the address."""
READ_SECONDS = 10.0
"""After which a browser that says nothing is let go, so that none can hold the server's threads for ever."""

LOCAL_NAMES = ("127.0.0.1", "localhost")


@contextmanager
def serving(page: str, port: int | None = None) -> Iterator[str]:
    """A server of one page in a thread of its own.

    Parameters
    ----------
    page : str
        HTML.
    port : int, optional
        By default 8160, or any free one where that is taken; 0 for any.

    Yields
    ------
    str
        Address of the page, with a random part that is new each time.

    Raises
    ------
    IrbcalError
        If the port cannot be had.
    """
    from threading import Thread

    token = secrets.token_urlsafe(TOKEN_BYTES)
    server = _open(page.encode("utf-8"), token, port)
    thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    thread.start()
    try:
        yield f"http://{ADDRESS}:{server.server_port}/{token}/"
    finally:
        server.shutdown()
        server.server_close()


def _open(body: bytes, token: str, port: int | None) -> _ViewServer:
    if port is None:
        try:
            return _ViewServer((ADDRESS, PORT), _handler(body, token))
        except OSError:
            port = 0  # any free one
    try:
        return _ViewServer((ADDRESS, port), _handler(body, token))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise IrbcalError(f"port {port} of {ADDRESS} cannot be used: {reason}", parameter="port") from None


class _ViewServer(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that went away is no error of ours."""


def _handler(body: bytes, token: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        server_version, sys_version = "irbcal", ""
        timeout = READ_SECONDS
        expected = f"/{token}"

        def do_GET(self) -> None:
            """The page, to whoever asks for it under a local name (not through a foreign domain's DNS)."""
            host = self.headers.get("Host", "").rsplit(":", 1)[0].lower()
            if host not in LOCAL_NAMES:
                self.send_error(403)
            elif not secrets.compare_digest(self.path.partition("?")[0].rstrip("/").encode(), self.expected.encode()):
                self.send_error(404)
            else:
                self.send_response(200)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("X-Content-Type-Options", "nosniff")
                self.send_header("Referrer-Policy", "no-referrer")
                self.end_headers()
                self.wfile.write(body)

        def log_message(self, *arguments: Any) -> None:
            """No line for each request."""

    return Handler


@dataclass(frozen=True, eq=False, repr=False)
class View(Result):
    """A scene and its page."""

    scene: PageScene

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: the page is made again."""
        return {"scene": self.scene}

    @cached_property
    def html(self) -> str:
        """The page: self-contained, no request to anywhere."""
        from irbcal.viewer import page

        return page.render(self.scene)

    def report(self) -> list[Paragraph]:
        """What there is to see, how large the errors are, and what the user should know."""
        scene = self.scene
        title = f"{scene.title}{', SIMULATED' if scene.simulated else ''}: "
        if scene.points is None:
            title += "its joints have sliders"
        else:
            kind = "poses of a plan" if scene.mode == "plan" else "measured poses"
            title += f"{len(scene.q)} {kind}, {len(scene.points.pose)} points of {', '.join(scene.targets)}"
        lines: list[Paragraph] = [title]
        if scene.features:
            lines.append(f"{len(scene.features)} features and known lengths stand at their fitted places")
        if scene.cell:
            lines.append(
                f"True frames of the cell, in the calibrated robot: {', '.join(one.label for one in scene.cell)}"
            )
        if scene.points is not None:
            lines += _errors(scene)
        return lines + remarks("Note", scene.notes)

    def to_frame(self) -> pd.DataFrame:
        """A row for each point, metres and radians, in the base link; no rows for a robot without poses.

        Columns ``pose``, ``group``, ``target`` and, where known, ``fitted``; ``calibrated_x_m`` … (where the robot
        predicts it), and where they are known ``measured_x_m`` …, ``nominal_x_m`` …, ``error_calibrated_m``,
        ``error_nominal_m``, ``turn_calibrated_rad``, ``turn_nominal_rad``.
        """
        import pandas as pd

        scene, points = self.scene, self.scene.points
        if points is None:
            return pd.DataFrame(columns=["pose", "group", "target"])
        columns: dict[str, Any] = {
            "pose": scene.pose_ids[points.pose],
            "group": scene.groups[points.pose],
            "target": np.array(list(scene.targets), dtype=object)[points.target],
            "fitted": None if scene.fitted is None else scene.fitted[points.pose],
        }
        for name in ("measured", "calibrated", "nominal"):
            columns |= values(points, f"{name}_x_m,{name}_y_m,{name}_z_m?={name}")
        columns |= {f"error_{name}_m": points.distance(name) for name in ("calibrated", "nominal")}
        columns |= values(points, "turn_calibrated_rad=turn_calibrated turn_nominal_rad=turn_nominal")
        return pd.DataFrame({name: column for name, column in columns.items() if column is not None})

    def _repr_html_(self) -> str:
        # no same-origin: the page's script cannot reach the notebook around it
        return (
            '<iframe sandbox="allow-scripts allow-downloads" style="width: 100%; height: 640px; border: 0" '
            f'srcdoc="{escape(self.html)}"></iframe>'
        )

    def save(self, path: str | Path) -> Path:
        """Write the page to a file: whole, or not at all.

        Parameters
        ----------
        path : str or Path

        Raises
        ------
        IrbcalError
            If it cannot be written.
        """
        from irbcal.errors import IrbcalError
        from irbcal.safe_files import write_together

        path = Path(path)
        if path.is_dir():
            raise IrbcalError("expected a file to write, found a folder", file=path)
        write_together(path.parent, {path.name: self.html.encode("utf-8")})
        return path

    def serve(self, port: int | None = None, open: bool = False, say: Callable[[str], Any] = print) -> None:
        """Serve the page on 127.0.0.1 until interrupted (Ctrl-C).

        Parameters
        ----------
        port : int, optional
            By default 8160, or a free one where that is taken.
        open : bool
            Open a browser.
        say : callable
            Takes the lines for the user.

        Raises
        ------
        IrbcalError
            If the port cannot be had.
        """
        import time

        with serving(self.html, port) as address:
            number = address.split("/")[2].rsplit(":", 1)[1]
            try:  # from here on Ctrl-C is how it ends, whatever is being said
                say(f"The view is at {address} (for browsers on this computer only; Ctrl-C ends).")
                tunnel = f"ssh -L {number}:127.0.0.1:{number} THIS-COMPUTER"
                say(f"From another computer: {tunnel}, then open the same address.")
                if open:
                    import webbrowser

                    webbrowser.open(address)
                while True:
                    time.sleep(3600)
            except KeyboardInterrupt:
                say("")


def _errors(scene: PageScene) -> list[Paragraph]:
    """Errors of both models, of held-out and of fitted poses apart where these are known."""
    points = scene.points
    models: tuple[WhichModel, ...] = ("nominal", "calibrated")
    assert points is not None
    errors = {model: error for model in models if (error := points.distance(model)) is not None}
    if not errors:
        return []
    kinds: dict[str, Any] = {"": slice(None)}
    if scene.fitted is not None and scene.fitted.any():
        fitted = scene.fitted[points.pose]
        kinds = {" of held-out poses": ~fitted, " of fitted poses": fitted}
    title = "Distances of rows from their features" if scene.at_features else "Errors"
    lines: list[Paragraph] = []
    for kind, rows in kinds.items():
        figures = [
            f"{model} {error[rows].mean() / MM:.3f} mm on average and at most {error[rows].max() / MM:.3f} mm"
            for model, error in errors.items()
            if len(error[rows])
        ]
        lines += [f"{title}{kind}: {'; '.join(figures)}"] if figures else []
    return lines
