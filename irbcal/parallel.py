"""What runs side by side, through one interface: threads, processes or a cluster's workers, all by joblib.

`using` says how many workers there are; `threads` and `each` take them. What comes out never depends on them: the work
is cut without regard to their number, results are put together in the order of the work, and linear algebra takes one
thread in each worker.
"""

from __future__ import annotations

import functools
import gc
import logging
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from types import FrameType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from irbcal.errors import IrbcalError, OptionError
from irbcal.option_values import number

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

P = ParamSpec("P")
S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

THREADS_PAY = 0.5
"""Seconds of work from which threads are taken: loading joblib takes 0.1."""
PROCESSES_PAY = 6.0
"""Seconds of work from which processes are taken unless they are asked for: each takes 1.5 to load irbcal."""
CHUNK = 50
"""Most tasks that go to a cluster's worker in one parcel: an empty parcel takes 3 ms, a small task 90."""
SCHEME = "dask://"
BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
MOST_WORKERS = 1024
"""Threads or processes; a machine of fewer cores is not faster with more."""
MOST_LOSSES = 2
"""How often a task may lose its worker before it runs alone, to see whether it is its own doing."""


@dataclass(frozen=True)
class Workers:
    """How many workers there are, and where."""

    jobs: int
    """On this machine."""
    requested: bool = False
    """Whether the number was asked for: then also for small work."""
    address: str | None = None
    """``HOST:PORT`` of a Dask scheduler."""


class Interrupted(KeyboardInterrupt):
    """Work that was interrupted, what was done of it kept: the same call goes on from there.

    Parameters
    ----------
    remaining : int
        How much is still to be done.
    tasks : str
        Of what, such as "robots to calibrate".
    """

    def __init__(self, remaining: int, tasks: str) -> None:
        self.remaining = remaining
        super().__init__(f"interrupted with {remaining} {tasks}: the same call goes on from there")


class WorkerLost(IrbcalError):
    """A task whose workers ended by themselves again and again."""


_current: ContextVar[Workers | None] = ContextVar("irbcal_workers", default=None)
_inside = threading.local()
_one_at_a_time = threading.Lock()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def workers() -> Workers:
    """The workers that `using` set; inside a worker one, else as many as there are cores."""
    if getattr(_inside, "worker", False):
        return Workers(1)
    return _current.get() or Workers(cores())


@contextmanager
def using(jobs: int | None = None, engine: str | None = None) -> Iterator[Workers]:
    """Work inside with so many workers.

    Parameters
    ----------
    jobs : int, optional
        Workers at a time, threads or processes: one for each core unless given. The result does not depend on it.
    engine : str, optional
        ``dask://HOST:PORT``: the workers of a Dask cluster in place of this machine's, which see the same paths. Needs
        ``irbcal[dask]``.

    Raises
    ------
    OptionError
        If ``jobs`` is not between 1 and `MOST_WORKERS`, or the engine is none.
    """
    jobs = None if jobs is None else number("jobs", jobs, 1, MOST_WORKERS, whole=True)
    previous = workers()
    if jobs is None and engine is None:
        current = previous
    else:
        current = Workers(previous.jobs if jobs is None else jobs, jobs is not None, _address(engine))
    token = _current.set(current)
    try:
        with one_thread():
            yield current
    finally:
        _current.reset(token)


def _address(engine: str | None) -> str | None:
    """``HOST:PORT`` of an engine."""
    if engine is None:
        return None
    host, _, port = engine.removeprefix(SCHEME).rpartition(":")
    if not engine.startswith(SCHEME) or not host or not port.isdecimal():
        raise OptionError(f"engine: expected {SCHEME}HOST:PORT, found {engine!r}", parameter="engine")
    return f"{host}:{port}"


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread for linear algebra inside: more add up their sums in another order, and get in each other's way."""
    if getattr(_inside, "limited", False):
        yield
        return
    _inside.limited = True
    previous = {name: os.environ.get(name) for name in BLAS_THREADS}
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))  # for libraries that are loaded inside
    try:
        with _linear_algebra(len(sys.modules)).limit(limits=1):
            yield
    finally:
        _inside.limited = False
        for name, value in previous.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@functools.lru_cache(maxsize=1)
def _linear_algebra(modules: int) -> Any:
    """The libraries of linear algebra that are loaded, looked for again where more modules are: that takes 1 ms."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def on_workers(function: Callable[P, R]) -> Callable[P, R]:
    """A function whose options ``jobs`` and, where it has one, ``engine`` are obeyed as `using` does."""

    @functools.wraps(function)
    def call(*args: P.args, **options: P.kwargs) -> R:
        jobs: Any = options.get("jobs")
        engine: Any = options.get("engine")
        with using(jobs, engine):
            return function(*args, **options)

    return call


# --- threads ------------------------------------------------------------------------------------------------


def threads(function: Callable[[T], R], items: Iterable[T], seconds: float) -> Iterator[R]:
    """Results of numpy work on large arrays, which leaves Python's lock, in the order of the items.

    Parameters
    ----------
    function : callable
    items : iterable
    seconds : float
        About how long all of it takes; below `THREADS_PAY` it is done one after the other.
    """
    count = workers().jobs
    if count < 2 or seconds < THREADS_PAY:
        yield from map(function, items)
        return
    from joblib import Parallel, delayed

    pool = Parallel(count, backend="threading", return_as="generator", batch_size=1)
    with one_thread():
        yield from pool(delayed(_within)(function, item) for item in items)


def _within(function: Callable[[T], R], task: T) -> R:
    """In a thread of the pool: what is parallel inside runs one after the other."""
    _inside.worker = True
    return function(task)


# --- processes, also of other machines ------------------------------------------------------------------------


def each(
    function: Callable[[S, T], R],
    shared: S,
    items: Sequence[T],
    *,
    seconds: float,
    lost: Callable[[T], R] | None = None,
    files: Sequence[str] = (),
) -> Iterator[tuple[int, R]]:
    """Places and results of tasks, as they end, from this process, processes of this machine or a cluster.

    A worker that is killed loses nothing: its tasks run again, and each result comes once. Ctrl-C lets tasks under way
    end and hands them over before it takes effect; a second one takes effect at once.

    Parameters
    ----------
    function : callable
        Of ``shared`` and an item; it must be found by its name in a module.
    shared
        What all tasks need; sent once to each worker.
    items : sequence
    seconds : float
        About how long one takes; see `PROCESSES_PAY`.
    lost : callable, optional
        The result of an item whose workers end by themselves again and again.
    files : sequence of str
        Paths that the workers of a cluster must see as this process does.

    Raises
    ------
    WorkerLost
        For such an item where ``lost`` is not given.
    IrbcalError
        If the cluster does not answer, or a worker does not see a file.
    """
    settings = workers()
    count = min(settings.jobs, len(items))
    apart = settings.address is not None or (count > 1 and (settings.requested or seconds * len(items) > PROCESSES_PAY))
    with _stopped_afterwards() as stopped, one_thread():
        if apart:
            yield from _apart(function, shared, items, replace(settings, jobs=count), stopped, lost, files)
        else:
            for index, task in enumerate(items):
                yield index, function(shared, task)
                if stopped():
                    break
        if stopped():
            raise KeyboardInterrupt


def _apart(
    function: Callable[[S, T], R],
    shared: S,
    items: Sequence[T],
    settings: Workers,
    stopped: Callable[[], bool],
    lost: Callable[[T], R] | None,
    files: Sequence[str],
) -> Iterator[tuple[int, R]]:
    """Rounds in workers until all is done; a round ends where a worker is lost."""
    import numpy as np

    blob = np.frombuffer(pickle.dumps(shared), dtype=np.uint8)
    parcel = _Parcel(
        function, blob, f"{os.getpid()}-{time.monotonic_ns()}", os.getpid() if settings.address is None else 0
    )
    remaining = dict(enumerate(items))
    losses = dict.fromkeys(remaining, 0)
    with _pool(settings, blob, files) as (count, options):
        while remaining and not stopped():
            suspects = [index for index in remaining if losses[index] >= MOST_LOSSES]
            order = suspects[:1] or list(remaining)
            size = max(1, min(CHUNK if settings.address else 1, len(order) // (4 * count)))
            sent: set[int] = set()
            chunks = [order[k : k + size] for k in range(0, len(order), size)]
            try:
                for task_number, result in _round(
                    parcel, remaining, chunks, (1 if suspects else count), options, sent, stopped
                ):
                    del remaining[task_number]
                    sent.discard(task_number)
                    yield task_number, result
            except _lost_errors():
                for task_number in sent:
                    losses[task_number] += 1
                if suspects:
                    yield suspects[0], _give_up(remaining.pop(suspects[0]), lost)


def _give_up(task: T, lost: Callable[[T], R] | None) -> R:
    if lost is None:
        subject = getattr(task, "name", task)
        raise WorkerLost(f"the processes that worked on {subject} ended by themselves, also alone (out of memory?)")
    return lost(task)


@dataclass(frozen=True, eq=False)
class _Parcel:
    """What all tasks of a call have in common."""

    function: Callable[[Any, Any], Any]
    blob: NDArray[np.uint8]
    """What they share, pickled: joblib sends large arrays once."""
    name: str
    """Of the blob."""
    parent: int
    """Process that a worker ends with; 0 for a cluster's."""


def _round(
    parcel: _Parcel,
    remaining: Mapping[int, T],
    chunks: Sequence[Sequence[int]],
    count: int,
    options: Mapping[str, Any],
    sent: set[int],
    stopped: Callable[[], bool],
) -> Iterator[tuple[int, Any]]:
    """Hand out chunks until all are done, a worker is lost or a stop is asked for."""
    from joblib import Parallel, delayed

    def tasks() -> Iterator[Any]:
        for chunk in chunks:
            if stopped():
                return
            sent.update(chunk)
            yield delayed(_task)(
                parcel.function, parcel.blob, parcel.name, parcel.parent, [(k, remaining[k]) for k in chunk]
            )

    # one at a time still takes a process of its own
    ahead = count + (count + 1) // 2 if count > 1 else 1
    pool = Parallel(max(2, count), return_as="generator_unordered", batch_size=1, pre_dispatch=ahead, **options)
    with _quiet_start():
        results = pool(tasks())
    for chunk in results:
        yield from chunk


def _task(
    function: Callable[[Any, Any], Any],
    blob: NDArray[np.uint8],
    name: str,
    parent: int,
    chunk: Sequence[tuple[int, Any]],
) -> list[tuple[int, Any]]:
    """In a worker: the tasks of a chunk, one thread at a time."""
    gc.set_threshold(300_000, 20, 100)  # as on the command line: modules and tables stay, searching them is in vain
    if parent:
        _end_with(parent)
    with _one_at_a_time, one_thread():
        _inside.worker = True
        shared = _unpacked(blob, name)
        return [(index, function(shared, task)) for index, task in chunk]


_kept: dict[str, Any] = {}


def _unpacked(blob: NDArray[np.uint8], name: str) -> Any:
    """What tasks share, unpickled once in each worker."""
    if name not in _kept:
        _kept.clear()
        _kept[name] = pickle.loads(blob.tobytes())
    return _kept[name]


_watched: set[int] = set()


def _end_with(parent: int) -> None:
    """A killed program leaves no worker behind."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    if parent not in _watched:
        _watched.add(parent)
        threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _pool(settings: Workers, blob: NDArray[np.uint8], files: Sequence[str]) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Number of workers and how joblib is told of them."""
    from joblib import parallel_config

    if settings.address is None:
        with parallel_config("loky", inner_max_num_threads=1):
            yield settings.jobs, {"max_nbytes": "1M"}
        return
    with _client(settings.address, files) as client, parallel_config("dask", client=client, scatter=[blob]):
        yield max(1, sum(client.nthreads().values())), {}


@contextmanager
def _client(address: str, files: Sequence[str]) -> Iterator[Any]:
    """A client of a Dask cluster, whose workers have the same versions as this process and see the same files."""
    try:
        from distributed import Client
        from distributed.comm import CommClosedError
    except ImportError:
        raise OptionError("engine: this needs Dask: pip install 'irbcal[dask]'", parameter="engine") from None
    try:
        client: Any = Client(address, timeout=10, set_as_default=False)
    except OSError:
        raise IrbcalError(f"no Dask scheduler answers at {address}", parameter="engine") from None
    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL)  # it tells a lost scheduler as a traceback
    try:
        versions, theirs = _versions(), client.run(_versions)
        if not theirs:
            raise IrbcalError(f"the Dask cluster at {address} has no workers", parameter="engine")
        for worker, other_versions in theirs.items():
            if other_versions != versions:
                raise IrbcalError(
                    f"the worker {worker} has {other_versions}, this process {versions}: results would differ",
                    parameter="engine",
                )
        for worker, path in client.run(_unseen, list(files)).items():
            if path is not None:
                raise IrbcalError(
                    f"the worker {worker} does not see {path}: workers need the same files under the same paths (a "
                    "folder that all machines share)",
                    parameter="engine",
                )
        try:
            yield client
        except (CancelledError, CommClosedError):
            raise IrbcalError(
                f"the Dask scheduler at {address} is gone: the same call goes on from there, with another engine or "
                "without",
                parameter="engine",
            ) from None
    finally:
        client.close(timeout=2)
        log.setLevel(level)


def _unseen(files: Sequence[str]) -> str | None:
    """In a worker: the first file that is not there."""
    return next((path for path in files if not os.path.exists(path)), None)


def _versions() -> str:
    """What results depend on."""
    import numpy
    import scipy

    import irbcal

    return f"irbcal {irbcal.__version__}, numpy {numpy.__version__}, scipy {scipy.__version__}"


def _lost_errors() -> tuple[type[BaseException], ...]:
    """What is raised where a worker ended by itself."""
    from joblib.externals.loky.process_executor import BrokenProcessPool

    try:
        from distributed import KilledWorker
    except ImportError:
        return (BrokenProcessPool,)
    return BrokenProcessPool, KilledWorker


# --- Ctrl-C -------------------------------------------------------------------------------------------------


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextmanager
def _stopped_afterwards() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed inside, which has no other effect; a second time it takes effect at once."""
    signals: list[int] = []
    if not _in_main_thread():
        yield lambda: False
        return

    def wait(number: int, frame: FrameType | None) -> None:
        if signals:
            raise KeyboardInterrupt
        signals.append(number)

    previous = signal.signal(signal.SIGINT, wait)
    try:
        yield lambda: bool(signals)
    finally:
        signal.signal(signal.SIGINT, previous)


@contextmanager
def _quiet_start() -> Iterator[None]:
    """Processes started inside leave Ctrl-C to this one."""
    if not _in_main_thread():
        yield
        return
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)  # a blocked signal would be let through by multiprocessing
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
