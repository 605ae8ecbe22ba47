"""Python's search for cyclic garbage rests while a program is taken to pieces and put together.

Tokens and targets by the hundred thousand stay until the program is written; to look through all of them again and
again finds nothing and takes a fifth of the time.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def resting() -> Iterator[None]:
    """No search within; as it was before afterwards."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
