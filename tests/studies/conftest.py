"""A small study, all of whose calibrations are made once."""

import pytest

from irbcal.studies import folder, runner
from irbcal.studies.results import Results
from irbcal.studies.settings import COURSE, Settings, repetitions
from irbcal.studies.stage import Stage
from irbcal.studies.tables import tables as tables_of

SMALL = Settings(procedures=(80, 120), each=2, curve=(80,), method="least-squares", points=520, seed=4)


@pytest.fixture(scope="session")
def small():
    """Settings of the small study."""
    return SMALL


@pytest.fixture(scope="session")
def stage():
    return Stage.of(SMALL)


@pytest.fixture(scope="session")
def done(stage):
    """Rows of all repetitions but the watched search, through CSV text as in a folder, and their series."""
    return {r: runner.finished(stage, r) for r in repetitions(SMALL) if r != COURSE}


@pytest.fixture(scope="session")
def frame(done, tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "results.csv"
    texts = [rows.decode() for rows, _ in done.values()]
    path.write_text(texts[0] + "".join(text.split("\n", 1)[1] for text in texts[1:]))
    return folder.read_rows(path)


@pytest.fixture(scope="session")
def results(frame):
    return Results(frame, SMALL)


@pytest.fixture(scope="session")
def tables(results):
    return {table.key: table for table in tables_of(results)}
