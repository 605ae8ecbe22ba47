"""Where the program starts, as ``irbcal`` and as ``python -m irbcal``."""

import gc
import os
import signal

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables by which the number of threads of linear algebra is told."""


def start() -> None:
    """Run the command line; Ctrl-C ends it with exit code 130 and without a word from the first moment on."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))  # while the program is loaded there is nothing to tidy up
    gc.set_threshold(
        100_000, 20, 100
    )  # modules and tables are loaded once and stay: searching them for cycles is in vain
    if not any(name in os.environ for name in THREADS):
        # matrices here are small: more threads take more CPU time, and a busy machine makes them wait for each other
        os.environ.update(dict.fromkeys(THREADS, "1"))
    from irbcal.cli.main import main
    from irbcal.cli.streams import forgive

    signal.signal(signal.SIGINT, signal.default_int_handler)
    forgive()
    try:
        main()
    except KeyboardInterrupt:
        os._exit(130)


if __name__ == "__main__":
    start()
