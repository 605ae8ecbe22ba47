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

_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """A public name, imported; a function refuses wrong calls in a sentence."""
    value = _attribute(name)
    if isinstance(value, type(__getattr__)):
        from irbcal.public_calls import refusing_wrong_calls

        globals()[name] = value = refusing_wrong_calls(value)
        value.__module__, value.__name__, value.__qualname__ = __name__, name, name  # where it is pickled from
    return value


__version__ = "0.2.0"
