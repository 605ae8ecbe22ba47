"""A small SIMULATED fleet, calibrated once, and a PostgreSQL server of its own."""

import postgres_server
import pytest
from fleet_support import manifest, measured

import irbcal
from irbcal.fleet import adding

ROBOTS = 3
OPTIONS = "model=offsets seed=3"


@pytest.fixture(scope="session")
def listed(tmp_path_factory):
    """A list of robots; the last one's file is missing."""
    folder = tmp_path_factory.mktemp("fleet")
    for k in range(ROBOTS):
        measured(folder, f"r{k}.csv", 10 + k, k)
    rows = [(f"R{k}", f"SN-{k}", f"r{k}.csv", "irb1600", "2026-03-02", OPTIONS) for k in range(ROBOTS)]
    return manifest(folder, [*rows, ("R9", "", "none.csv", "irb1600", "", "")])


@pytest.fixture(scope="session")
def calibrated(listed, tmp_path_factory):
    """That list, calibrated in this process."""
    return irbcal.fleet_calibrate(listed, tmp_path_factory.mktemp("out") / "fleet", jobs=1)


@pytest.fixture(scope="session")
def stored(calibrated):
    """Its calibrations as the store takes them."""
    return [adding.stored(calibrated.out / f"R{k}") for k in range(ROBOTS)]


@pytest.fixture(scope="session")
def server():
    """URL of a database on a PostgreSQL server that runs for these tests."""
    try:
        with postgres_server.server() as url:
            yield url
    except postgres_server.Absent as reason:
        pytest.skip(str(reason))


@pytest.fixture(params=["sqlite", "postgresql"])
def place(request, tmp_path):
    """An empty store of each kind."""
    if request.param == "sqlite":
        yield str(tmp_path / "fleet.db")
        return
    url = request.getfixturevalue("server")
    yield url
    postgres_server.emptied(url)
