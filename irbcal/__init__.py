"""irbcal: calibrate robot arms from laser-tracker measurements, with URDF in and URDF out.

The public names are those of the stub beside this file; they are imported on first use, so that ``import irbcal``
stays quick.
"""

import sys

if (
    "irbcal"
    in (  # the program, not the library
        sys.argv[0].replace("\\", "/").rpartition("/")[2].removesuffix(".exe"),
        *sys.orig_argv[1:3],
    )
):
    import _signal  # quicker than signal, which makes enumerations of it

    _signal.signal(
        _signal.SIGINT, _signal.SIG_DFL
    )  # until `irbcal.__main__` knows better: Ctrl-C ends it without a word

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

__version__ = "0.2.0"
