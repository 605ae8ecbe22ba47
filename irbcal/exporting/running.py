"""The loop of live correction: a line in, a line out, and how long each took."""

from __future__ import annotations

import gc
from collections.abc import Callable
from time import perf_counter_ns
from typing import IO

import numpy as np

from irbcal.exporting.live import LONGEST_LINE, Live

BUCKETS = 100_000
"""Microseconds that are told apart; longer ones count as this many."""


class Latencies:
    """How long answers took, in whole microseconds, in a memory that does not grow."""

    def __init__(self) -> None:
        self._counts = [0] * (BUCKETS + 1)
        self.longest_ns = 0

    def add(self, ns: int) -> None:
        """Count one answer."""
        self._counts[min(ns // 1000, BUCKETS)] += 1
        if ns > self.longest_ns:
            self.longest_ns = ns

    def quantile(self, share: float) -> int:
        """Microseconds that so large a share of the answers did not exceed."""
        counts = np.cumsum(self._counts)
        if not counts[-1]:
            return 0
        return int(np.searchsorted(counts, share * counts[-1])) + 1

    def in_words(self, live: Live) -> str:
        """What is told at the end."""
        if not live.lines:
            return "no lines"
        return (
            f"{live.lines} lines, {live.held} held; a line took {self.quantile(0.5)} us (median), "
            f"{self.quantile(0.999)} us (99.9th percentile), {self.longest_ns // 1000} us (longest)"
        )


def run(live: Live, lines: IO[bytes], out: IO[bytes], tell: Callable[[str], None]) -> None:
    """Answer lines until there are no more, or the user stops.

    Parameters
    ----------
    live : Live
    lines, out : binary streams
        Each answer is flushed at once.
    tell : callable
        Given the latencies in words at the end.
    """
    latencies = Latencies()
    gc.collect()
    gc.freeze()  # what is there stays; a collection would cost milliseconds
    gc.disable()
    try:
        while line := lines.readline(LONGEST_LINE + 1):
            start = perf_counter_ns()
            if len(line) > LONGEST_LINE and not line.endswith(b"\n"):
                _rest(lines)
            out.write(live.answer(line).encode() + b"\n")
            out.flush()
            latencies.add(perf_counter_ns() - start)
    except KeyboardInterrupt:
        pass
    finally:
        gc.enable()
        gc.unfreeze()
        tell(latencies.in_words(live))


def _rest(lines: IO[bytes]) -> None:
    """Read on to the end of a line that is too long."""
    while (more := lines.readline(LONGEST_LINE)) and not more.endswith(b"\n"):
        pass
