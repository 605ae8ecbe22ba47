"""What runs side by side gives what one after the other gives; lost workers and Ctrl-C lose nothing."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fleet_support import manifest, measured
from parallel_tasks import deadly, matrix, process, slow
from threadpoolctl import threadpool_limits

import irbcal
from irbcal import parallel
from irbcal.errors import IrbcalError, OptionError
from irbcal.identification import problem
from irbcal.io import robots
from irbcal.measurement import cleaning
from irbcal.validation import accuracy


def test_threads_keep_the_order_and_are_taken_for_large_work_only(monkeypatch):
    items = list(range(20))
    with parallel.using(2):
        found = list(parallel.threads(lambda k: matrix(40, k), items, 10.0))
        monkeypatch.setitem(sys.modules, "joblib", None)  # cannot be imported
        assert found == list(parallel.threads(lambda k: matrix(40, k), items, 0.1))
    with parallel.using(1):
        assert found == list(parallel.threads(lambda k: matrix(40, k), items, 10.0))


def test_inside_a_thread_there_is_one_worker():
    with parallel.using(2):
        assert set(parallel.threads(lambda _: parallel.workers().jobs, range(4), 10.0)) == {1}
        assert parallel.workers().jobs == 2


def test_processes_give_the_same_bytes_each_once():
    with parallel.using(1):
        alone = dict(parallel.each(matrix, 60, range(6), seconds=9.0))
    with parallel.using(2):
        found = list(parallel.each(matrix, 60, range(6), seconds=0.0))
    assert len(found) == 6
    assert dict(found) == alone


def test_small_work_stays_here_unless_workers_are_asked_for():
    pids = {pid for _, pid in parallel.each(process, None, range(4), seconds=0.01)}
    assert pids == {os.getpid()}


def test_a_killed_worker_loses_nothing_and_a_deadly_task_is_named(tmp_path):
    with parallel.using(2):
        found = list(parallel.each(deadly, str(tmp_path), range(7), seconds=0.0, lost=lambda item: -item))
        assert sorted(found) == [(k, -5 if k == 5 else k * k) for k in range(7)]
    with pytest.raises(parallel.WorkerLost, match="worked on 5 ended by themselves, also alone"):
        parallel._give_up(5, None)


def test_workers_and_threads_of_the_blas_change_no_byte_of_a_calibration(monkeypatch):
    """Every problem counts as large, and is cut into blocks of 20 poses."""
    monkeypatch.setattr(parallel, "THREADS_PAY", 0.0)
    monkeypatch.setattr(problem, "BLOCK", 20)
    monkeypatch.setattr(accuracy, "BLOCK", 20_000)
    seen = pd.read_csv(robots.demo_file("demo_identification.csv"))
    seen = seen[seen["pose"].isin(seen["pose"].unique()[:40])]
    points = cleaning.clean(irbcal.read_measurements(seen)).points
    arm = irbcal.read_urdf("irb1600").arm

    def found(jobs, threads):
        with threadpool_limits(threads), parallel.using(jobs):
            fit = irbcal.identify_evidence(arm, points)
            intervals = accuracy.intervals(np.abs(np.sin(np.arange(600))), np.arange(600) // 3)
        return fit.covariance.tobytes(), fit.coefficients.tobytes(), intervals

    assert found(1, 1) == found(2, 2)


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="irbcal[dask] is not installed")
    dask = pytest.importorskip("dask")
    tests = str(Path(__file__).parent)
    with (
        dask.config.set({"distributed.nanny.environ.PYTHONPATH": f"{tests}:{os.environ.get('PYTHONPATH', '')}"}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1", silence_logs=50
        ) as found,
    ):
        yield found


def test_a_dask_cluster_gives_the_same_bytes_also_where_a_worker_is_killed(cluster, tmp_path):
    address = address_of(cluster)
    alone = dict(parallel.each(matrix, 60, range(6), seconds=0.0))
    with parallel.using(engine=address):
        assert dict(parallel.each(matrix, 60, range(6), seconds=0.0)) == alone
        assert sorted(parallel.each(deadly, str(tmp_path), range(5), seconds=0.0)) == [(k, k * k) for k in range(5)]
    assert len(list(tmp_path.glob("3-*"))) == 2


SCHEDULER = """
import sys, time
from distributed import LocalCluster
if __name__ == "__main__":
    found = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1", silence_logs=50)
    print(found.scheduler_address, flush=True)
    time.sleep(300)
"""


@contextmanager
def processes_of(script, folder):
    """A script that makes a cluster and prints its address, in a session of its own; the process, and what it printed."""
    pytest.importorskip("distributed", reason="irbcal[dask] is not installed")
    (folder / "cluster.py").write_text(script)
    path = f"{Path(__file__).parent}:{os.environ.get('PYTHONPATH', '')}"
    with subprocess.Popen(
        [sys.executable, folder / "cluster.py"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
        start_new_session=True,
    ) as process:
        try:
            address, *more = process.stdout.readline().split()
            with parallel.using(engine=f"dask://{address.removeprefix('tcp://')}"):
                yield process.pid, more
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def test_a_killed_scheduler_is_one_sentence(tmp_path):
    with processes_of(SCHEDULER, tmp_path) as (scheduler, _):
        results = parallel.each(slow, None, range(200), seconds=0.0)
        next(results)
        os.killpg(scheduler, signal.SIGKILL)
        with pytest.raises(IrbcalError, match=r"scheduler at .* is gone"):
            list(results)


def address_of(cluster):
    return "dask://" + cluster.scheduler_address.removeprefix("tcp://")


def numbers(out):
    """What was found, without dates, durations and what is made of them."""
    passing = ("created", "seconds", "history", "calibrated_urdf_sha256", "seal")
    found = {}
    for path in sorted(out.glob("*/calibration.json")):
        record = json.loads(path.read_bytes())
        found[path.parent.name] = {name: value for name, value in record.items() if name not in passing}
    return found


def test_a_fleet_on_a_cluster_is_that_of_one_process_also_where_a_worker_is_killed(cluster, tmp_path):
    """And the store takes each robot once, whoever calibrated it. Two processes: tests/fleet/test_batch.py."""
    distributed = pytest.importorskip("distributed")
    for k in range(2):
        measured(tmp_path, f"r{k}.csv", 20 + k, k, poses=16)
    listed = manifest(tmp_path, [(f"R{k}", "", f"r{k}.csv", "irb1600", "", "model=offsets") for k in range(2)])
    irbcal.fleet_calibrate(listed, tmp_path / "one", jobs=1)
    killed = []

    def kill(text):
        if not killed:
            with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
                killed.extend(client.run(os.getpid).values())
            os.kill(killed[0], signal.SIGKILL)

    found = irbcal.fleet_calibrate(listed, tmp_path / "cluster", engine=address_of(cluster), progress=kill)
    assert len(killed) == 2
    assert (found.calibrated, found.reused, found.failures) == (2, 0, ())
    assert len(numbers(tmp_path / "one")) == 2
    assert numbers(tmp_path / "cluster") == numbers(tmp_path / "one")
    assert len(irbcal.fleet_add(tmp_path / "cluster", tmp_path / "fleet.db").added) == 2
    assert len(irbcal.fleet_add(tmp_path / "one", tmp_path / "fleet.db").already_stored) == 2


def test_a_file_that_a_worker_does_not_see_is_named(cluster, tmp_path):
    with parallel.using(engine=address_of(cluster)):
        gone = str(tmp_path / "gone.csv")
        with pytest.raises(IrbcalError, match=r"the worker tcp://.* does not see .*gone\.csv: workers need the same"):
            list(parallel.each(matrix, 60, range(6), seconds=0.0, files=[str(tmp_path), gone]))


NANNIES = """
import subprocess, sys, time
from distributed import LocalCluster
if __name__ == "__main__":
    found = LocalCluster(n_workers=0, dashboard_address=None, host="127.0.0.1", silence_logs=50)
    command = [sys.executable, "-m", "distributed.cli.dask_worker", found.scheduler_address]
    options = ["--nthreads", "1", "--no-dashboard", "--nanny", "--host", "127.0.0.1"]
    nannies = [subprocess.Popen([*command, *options], stderr=subprocess.DEVNULL) for _ in range(2)]
    while len(found.scheduler_info["workers"]) < 2:
        time.sleep(0.1)
    print(found.scheduler_address, nannies[0].pid, flush=True)
    time.sleep(300)
"""


def test_a_killed_nanny_loses_nothing(tmp_path):
    """The process that watches a worker is killed; its worker ends with it, and the other one does the rest."""
    with processes_of(NANNIES, tmp_path) as (_, [nanny]):
        results = parallel.each(slow, None, range(12), seconds=0.0)
        done = [next(results)]
        os.kill(int(nanny), signal.SIGKILL)
        done += results
    assert sorted(index for index, _ in done) == list(range(12))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"jobs": 0}, "jobs: expected a whole number from 1 to 1024, found 0"),
        ({"jobs": 10**26}, "jobs: expected a whole number from 1 to 1024, found 100000000000000000000000000"),
        ({"engine": "spark://here:1"}, "engine: expected dask://HOST:PORT, found 'spark://here:1'"),
        ({"engine": "dask://here"}, "engine: expected dask://HOST:PORT, found 'dask://here'"),
    ],
)
def test_wrong_workers_are_refused(options, sentence):
    with pytest.raises(OptionError) as caught, parallel.using(**options):
        pass
    assert str(caught.value) == sentence


def test_a_cluster_that_is_not_there_is_named(monkeypatch):
    distributed = pytest.importorskip("distributed", reason="irbcal[dask] is not installed")

    def refuse(*arguments, **options):
        raise OSError("timed out")

    monkeypatch.setattr(distributed, "Client", refuse)
    with (
        parallel.using(engine="dask://127.0.0.1:9"),
        pytest.raises(IrbcalError, match=r"no Dask scheduler answers at 127"),
    ):
        list(parallel.each(matrix, 3, range(2), seconds=0.0))


def test_an_interruption_lets_what_is_under_way_end():
    before, seen = signal.getsignal(signal.SIGINT), []

    def interrupted():
        for place, _ in parallel.each(matrix, 3, range(5), seconds=0.0):
            seen.append(place)
            signal.raise_signal(signal.SIGINT)

    with parallel.using(1), pytest.raises(KeyboardInterrupt):
        interrupted()
    assert seen == [0]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_killed_program_leaves_no_process(tmp_path):
    code = (
        "import os, sys, time; sys.path.insert(0, sys.argv[1]); import parallel_tasks as t; from irbcal import parallel\n"
        "if __name__ == '__main__':\n"
        "    with parallel.using(2):\n"
        "        for _, pid in parallel.each(t.process, None, range(1000), seconds=9.0): print(pid, flush=True); time.sleep(0.01)\n"
    )
    script = tmp_path / "script.py"
    script.write_text(code)
    program = subprocess.Popen([sys.executable, script, Path(__file__).parent], stdout=subprocess.PIPE, text=True)
    worker = int(program.stdout.readline())
    program.kill()
    program.wait()
    deadline = time.monotonic() + 20
    while Path(f"/proc/{worker}").exists() and Path(f"/proc/{worker}/stat").read_text().split()[2] != "Z":
        assert time.monotonic() < deadline
        time.sleep(0.05)
    program.stdout.close()
