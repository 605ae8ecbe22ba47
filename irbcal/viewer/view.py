"""A calibrated robot, its measured points and its errors to look at, in a browser or a notebook.

::

    import irbcal

    view = irbcal.view("my-robot", "verification.csv")
    view                       # in a notebook: shows itself
    view.save("view.html")     # one self-contained page for a colleague
    view.serve(open=True)      # in a browser on this computer
"""

from functools import cached_property
from html import escape
from pathlib import Path

__all__ = ["View", "view"]


def view(
    source,
    measurements=None,
    *,
    plan=None,
    magnification=None,
    package_dirs=(),
    cube=None,
    refit_base=False,
    base=None,
    tip=None,
):
    """Look at a calibration, or at a robot.

    Parameters
    ----------
    source : str, Path or Calibration
        Calibration folder; a URDF or a shipped robot's name (then there is nothing measured to show).
    measurements : str, Path or MeasurementSet, optional
        Measured points; a file that holds joints only is taken as a plan. Without it, the joints have sliders.
    plan : str, Path or array_like of shape (n, joints), optional
        Joints to walk through, linearly from pose to pose: a file, or an array in radians (metres for prismatic
        joints).
    magnification : float, optional
        Of the error vectors; by default a round number that makes them visible.
    package_dirs : sequence of str or Path
        Folders in which ``package://`` names of meshes are looked up.
    cube : (array_like of shape (3,), float), optional
        ISO 9283 cube: centre in the base link and edge, metres. By default that of the IRB 1600, for it only.
    refit_base : bool
        Place the base anew on the measurements (tracker or robot was moved).
    base, tip : str, optional
        Link names, for a URDF; see `irbcal.read_urdf`.

    Returns
    -------
    View

    Raises
    ------
    IrbcalError
        If an input is refused.

    Examples
    --------
    >>> view = irbcal.view("my-robot", "verification.csv", magnification=200)  # doctest: +SKIP
    >>> view.save("view.html")  # doctest: +SKIP
    """
    from irbcal.viewer import scene

    return View(
        scene.build(
            source,
            measurements,
            plan=plan,
            magnification=magnification,
            package_dirs=package_dirs,
            cube=cube,
            refit_base=refit_base,
            base=base,
            tip=tip,
        )
    )


setattr(view, "show", view)  # noqa: B010 - `irbcal.view.show` is what the function was called first


class View:
    """A scene and its page.

    Parameters
    ----------
    scene : irbcal.viewer.scene.Scene
    """

    def __init__(self, scene):
        self.scene = scene

    @cached_property
    def html(self):
        """The page: self-contained, no request to anywhere."""
        from irbcal.viewer import page

        return page.render(self.scene)

    def _repr_html_(self):
        # no same-origin: the page's script cannot reach the notebook around it
        return (
            '<iframe sandbox="allow-scripts allow-downloads" style="width: 100%; height: 640px; border: 0" '
            f'srcdoc="{escape(self.html)}"></iframe>'
        )

    def save(self, path):
        """Write the page to a file: whole, or not at all.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Path

        Raises
        ------
        IrbcalError
            If it cannot be written.
        """
        from irbcal.errors import IrbcalError
        from irbcal.files.atomic import write_together

        path = Path(path)
        if path.is_dir():
            raise IrbcalError(f"{path}: expected a file to write, found a folder")
        write_together(path.parent, {path.name: self.html.encode("utf-8")})
        return path

    def serve(self, port=None, open=False, say=print):
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

        from irbcal.viewer import server

        with server.serving(self.html, port) as address:
            number = address.rstrip("/").rsplit(":", 1)[1]
            say(f"The view is at {address} (for browsers on this computer only; Ctrl-C ends).")
            say(f"From another computer: ssh -L {number}:127.0.0.1:{number} THIS-COMPUTER, then open the same address.")
            if open:
                import webbrowser

                webbrowser.open(address)
            try:
                while True:
                    time.sleep(3600)
            except KeyboardInterrupt:
                say("")
