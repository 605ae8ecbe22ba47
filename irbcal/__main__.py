"""Where the program starts, as ``irbcal`` and as ``python -m irbcal``."""

import atexit
import gc
import importlib.util
import os
import signal
import sys
import threading
from types import ModuleType
from typing import Any

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables by which the number of threads of linear algebra is told."""


class Late(ModuleType):
    """A module that is loaded with its first use, whoever imported it before."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._lock = threading.RLock()

    def __getattr__(self, name: str) -> Any:
        if name == "__path__" and self.__spec__ is None:  # asked of each module that something is imported from
            raise AttributeError(name)
        with self._lock:
            if sys.modules.get(self.__name__) is self:
                del sys.modules[self.__name__]
                vars(self).update(vars(importlib.import_module(self.__name__)))
        return getattr(sys.modules[self.__name__], name)


def start() -> None:
    """Run the command line; Ctrl-C ends it with exit code 130 and without a word from the first moment on."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))  # while the program is loaded there is nothing to tidy up
    # modules and tables are loaded once and stay: searching them for cycles is in vain
    gc.set_threshold(300_000, 20, 100)
    if not any(name in os.environ for name in THREADS):
        # matrices here are small: more threads take more CPU time, and a busy machine makes them wait for each other
        os.environ.update(dict.fromkeys(THREADS, "1"))
    _keep_memory()
    for name in ("pandas", "yaml"):  # many commands need neither
        if name not in sys.modules:
            late = Late(name)
            late.__spec__ = importlib.util.find_spec(name)  # others ask by it whether the package is there
            sys.modules[name] = late
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # it reads the metadata of all packages to find some
    if os.environ["PYDANTIC_DISABLE_PLUGINS"] == "__all__":
        # the module that looks for them loads the reader of metadata, and with it that of e-mails
        plugins: Any = Late("pydantic.plugin._loader")
        plugins.get_plugins = tuple
        sys.modules[plugins.__name__] = plugins
    from irbcal.cli.main import main
    from irbcal.cli.streams import forgive, output_lost

    forgive()
    sys.unraisablehook = _stopped_or_shown
    code = 0
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        main()
    except KeyboardInterrupt:
        os._exit(130)
    except SystemExit as end:
        if end.code is not None and not (isinstance(end.code, int) and 0 <= end.code < 256):
            raise
        code = end.code or 0
    if code == 0 and output_lost():
        print("irbcal: standard output is closed: what was to be printed there is lost", file=sys.stderr)
        code = 1
    leave(code)


def _keep_memory() -> None:
    """Keep what is freed for what is allocated next, where the C library is GNU's; here and in workers.

    Else each larger array is cleared by the kernel, page by page: up to a tenth of the time of a calibration.
    """
    import ctypes

    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    for name, option, size in (("MMAP", -3, 2**25), ("TRIM", -1, 2**26)):
        if mallopt is not None and f"MALLOC_{name}_THRESHOLD_" not in os.environ:
            mallopt(option, size)
            os.environ[f"MALLOC_{name}_THRESHOLD_"] = str(size)


def _stopped_or_shown(unraisable: "sys.UnraisableHookArgs") -> None:
    """End where Ctrl-C came while Python could not raise it, as between two imports: it would be dropped."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        os._exit(130)
    sys.__unraisablehook__(unraisable)


def leave(code: int) -> None:
    """End the process as `sys.exit` does, but without taking all modules apart: a tenth of a short command's time.

    What is registered with `atexit` is done and Python's streams are flushed; buffers of libraries in C are not. Where
    threads or children may still be at work, Python ends itself.
    """
    if _at_work():
        sys.exit(code)
    atexit._run_exitfuncs()
    if _at_work():
        sys.exit(code)
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except (OSError, ValueError):  # Python says what is wrong with them
        sys.exit(code)
    os._exit(code)


def _at_work() -> bool:
    return threading.active_count() > 1 or "joblib" in sys.modules or "multiprocessing.process" in sys.modules


if __name__ == "__main__":
    start()
