"""What the workers of tests/test_parallel.py do; beside it, for they import this file, and little else."""

import os
import signal
import time
from pathlib import Path

import numpy as np


def matrix(shared, item):
    """Numbers that depend on the order in which linear algebra adds up."""
    A = np.random.default_rng(item).standard_normal((shared, 3 * shared))
    return (np.linalg.inv(A @ A.T) @ A).tobytes()


def slow(shared, item):
    time.sleep(0.05)


def deadly(folder, item):
    """Item 3 kills its worker the first time, item 5 always."""
    path = Path(folder) / f"{item}-{time.monotonic_ns()}"
    path.touch()
    if item == 5 or (item == 3 and len(list(Path(folder).glob("3-*"))) == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    return item * item


def process(shared, item):
    return os.getpid()
