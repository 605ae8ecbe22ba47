"""Where the program starts, as ``irbcal`` and as ``python -m irbcal``."""

import os
import signal


def start() -> None:
    """Run the command line; Ctrl-C ends it with exit code 130 and without a word from the first moment on."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))  # while the program is loaded there is nothing to tidy up
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
