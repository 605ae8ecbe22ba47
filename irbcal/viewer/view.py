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
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import IrbcalError
from irbcal.modeling import frames
from irbcal.modeling.home import home_joints
from irbcal.summary import Paragraph, Result
from irbcal.units import MM
from irbcal.viewer.scene import Points

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    from irbcal.cell.cell_file import CellFile
    from irbcal.io.opening import RobotLike
    from irbcal.measurement.table import MeasurementsLike
    from irbcal.planning.measuring_plan import Plan
    from irbcal.viewer.scene import PageScene, PlanLike, WhichModel


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


def _open(body: bytes, token: str, port: int | None) -> _Server:
    if port is None:
        try:
            return _Server((ADDRESS, PORT), _handler(body, token))
        except OSError:
            port = 0  # any free one
    try:
        return _Server((ADDRESS, port), _handler(body, token))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise IrbcalError(f"port {port} of {ADDRESS} cannot be used: {reason}", parameter="port") from None


class _Server(ThreadingHTTPServer):
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


__all__ = ["View", "view"]


def view(
    source: RobotLike,
    measurements: MeasurementsLike | None = None,
    *,
    plan: PlanLike | None = None,
    magnify: float | None = None,
    package_dirs: Sequence[str | Path] = (),
    cube: tuple[ArrayLike, float] | None = None,
    refit_base: bool = False,
    refit_tool: bool = False,
    base_link: str | None = None,
    tip_link: str | None = None,
    cell: CellFile | str | Path | None = None,
) -> View:
    """Look at a calibration, or at a robot.

    Parameters
    ----------
    source : str, Path, or a calibration
        Calibration folder or a calibration; a URDF or a shipped robot's name (then there is nothing measured to show).
    measurements : str, Path, DataFrame or MeasurementSet, optional
        Measured points; a table that holds joints only is taken as a plan. Without it, the joints have sliders.
    plan : str, Path, DataFrame or array_like of shape (n, joints), optional
        Joints to walk through, linearly from pose to pose: a table (columns q1_deg …), or an array in radians (metres
        for prismatic joints).
    magnify : float, optional
        Magnification of the error vectors; by default a round number that makes them visible.
    package_dirs : sequence of str or Path
        See `irbcal.read_urdf`.
    cube : (array_like of shape (3,), float), optional
        ISO 9283 cube: centre in the base link and edge, metres. By default that of the IRB 1600, for it only.
    refit_base : bool
        Place the base anew on the measurements (tracker or robot was moved).
    refit_tool : bool
        Place the targets anew (reflectors were mounted anew, or a calibration without a tracker has none): on half of
        the poses, the others are shown.
    base_link, tip_link : str, optional
        See `irbcal.read_urdf`.
    cell : CellFile, str or Path, optional
        Tools and work objects to draw, of a file that ``irbcal cell`` wrote with this calibration; labels have what
        holds 95 % of the errors of their coordinates.

    Raises
    ------
    OptionError
        If the magnification is not above zero and at most 1e6.
    RobotError
        If there is no such robot, its URDF cannot be used, or plan or cube do not fit it.
    CalibrationError
        If a calibration cannot be read, or does not hold the robot's looks.
    MeasurementError
        If measurements are refused, or given together with a plan or for a robot that is not calibrated.

    Examples
    --------
    >>> view = irbcal.view("my-robot", "verification.csv", magnify=200)  # doctest: +SKIP
    >>> view.save("view.html")  # doctest: +SKIP
    """
    from irbcal.viewer import building

    return View(
        building.build(
            source,
            measurements,
            plan=plan,
            magnify=magnify,
            package_dirs=package_dirs,
            cube=cube,
            refit_base=refit_base,
            refit_tool=refit_tool,
            base_link=base_link,
            tip_link=tip_link,
            cell=cell,
        )
    )


setattr(view, "show", view)  # noqa: B010 - `irbcal.view.show` is what the function was called first


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
        return lines + [f"Note: {note}" for note in scene.notes]

    def to_frame(self) -> pd.DataFrame:
        """A row for each point, metres and radians, in the base link; no rows for a robot without poses.

        Columns ``pose``, ``group``, ``target`` and, where known, ``fitted``; ``calibrated_x_m`` … (where the robot
        predicts it), and where they are known ``measured_x_m`` …, ``nominal_x_m`` …, ``error_calibrated_m``,
        ``error_nominal_m``, ``turn_calibrated_rad``, ``turn_nominal_rad``.
        """
        import numpy as np
        import pandas as pd

        scene, points = self.scene, self.scene.points
        if points is None:
            return pd.DataFrame(columns=["pose", "group", "target"])
        columns: dict[str, Any] = {
            "pose": scene.pose_ids[points.pose],
            "group": scene.groups[points.pose],
            "target": np.array(list(scene.targets), dtype=object)[points.target],
        }
        if scene.fitted is not None:
            columns["fitted"] = scene.fitted[points.pose]
        places = {"measured": points.measured, "calibrated": points.calibrated, "nominal": points.nominal}
        for name, xyz in places.items():
            if xyz is not None:
                columns |= {f"{name}_{axis}_m": xyz[:, k] for k, axis in enumerate("xyz")}
        single = {
            "error_calibrated_m": points.distance("calibrated"),
            "error_nominal_m": points.distance("nominal"),
            "turn_calibrated_rad": points.turn_calibrated,
            "turn_nominal_rad": points.turn_nominal,
        }
        return pd.DataFrame(columns | {name: values for name, values in single.items() if values is not None})

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


def plan_page(plan: Plan) -> str:
    """The page of a plan, self-contained HTML: robot, tracker, cube, reflectors and their way from pose to pose."""
    scene, setting, options = plan.scene, plan.scene.setting, plan.options
    view_page = view(
        options.robot,
        plan=np.array(plan.q),
        package_dirs=options.package_dirs,
        cube=scene.cube,
        base_link=options.base_link,
        tip_link=options.tip_link,
    ).scene
    pose, target, xyz, _ = plan.expected()
    T_scene_world = frames.inverse(scene.T_world_base)
    return View(
        replace(
            view_page,
            robot=setting.robot.replace(T_world_base=scene.T_world_base),
            targets=dict(zip(setting.targets.names, setting.targets.places, strict=True)),
            points=Points(pose, target, frames.apply(T_scene_world, xyz)),
            groups=plan.groups,
            path=_way(plan),
            over_home=(home_joints(setting.arm), np.flatnonzero(plan.over_home)),
            T_scene_world=T_scene_world,
            tracker=True,
        )
    ).html


def _way(plan: Plan) -> FloatArray:
    """Way of the first reflector from home over all poses and back in the base link, (k, 3), metres."""
    from irbcal.planning import measuring_plan, route

    setting, q_stops = plan.scene.setting, measuring_plan.moves(plan).q
    q, _ = route.between(q_stops[:-1], q_stops[1:], setting.arm.table.prismatic)
    return setting.places(q)[1][:, 0]
