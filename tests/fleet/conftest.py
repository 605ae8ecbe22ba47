"""A small SIMULATED fleet, calibrated once, and a PostgreSQL server of its own."""

import os
import shutil
import socket
import subprocess
from pathlib import Path

import pytest
from fleet_support import manifest, measured

import irbcal
from irbcal.fleet import records

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
    return [records.stored(calibrated.out / f"R{k}") for k in range(ROBOTS)]


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """URL of a database on a PostgreSQL server that runs for these tests, on loopback only."""
    pytest.importorskip("psycopg", reason="irbcal[postgres] is not installed")
    places = [
        Path(shutil.which("initdb") or "/").parent,
        *sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True),
    ]
    binaries = next((place for place in places if (place / "initdb").is_file()), None)
    if binaries is None:
        pytest.skip("PostgreSQL is not installed (Debian: postgresql)")
    as_user = []
    folder = tmp_path_factory.mktemp("postgres")
    if os.geteuid() == 0:
        if not shutil.which("setpriv"):
            pytest.skip("PostgreSQL does not run as root, and there is no setpriv")
        as_user = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
        place = Path("/tmp") / f"irbcal-postgres-{os.getpid()}"  # pytest's own folders are root's alone
        place.mkdir(mode=0o700)
        os.chown(place, 65534, 65534)
    else:
        place = folder
    data = place / "data"
    command = [binaries / "initdb", "-D", data, "-U", "irbcal", "--auth=trust", "--no-sync", "-E", "UTF8", "--locale=C"]
    made = subprocess.run([*as_user, *command], capture_output=True, text=True, cwd="/")
    if made.returncode:
        pytest.skip(f"initdb failed: {made.stderr.strip().splitlines()[-1]}")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories= -c fsync=off"
    control = [*as_user, str(binaries / "pg_ctl"), "-D", str(data)]
    log = ["-l", str(place / "log")]
    subprocess.run([*control, *log, "-o", options, "-w", "start"], check=True, capture_output=True, cwd="/")
    yield f"postgresql+psycopg://irbcal@127.0.0.1:{port}/postgres"
    subprocess.run([*control, "-m", "immediate", "stop"], check=True, capture_output=True, cwd="/")
    shutil.rmtree(place)


@pytest.fixture(params=["sqlite", "postgresql"])
def place(request, tmp_path):
    """An empty store of each kind."""
    if request.param == "sqlite":
        yield str(tmp_path / "fleet.db")
        return
    import sqlalchemy as sql

    url = request.getfixturevalue("server")
    yield url
    engine = sql.create_engine(url)
    with engine.begin() as link:
        link.execute(sql.text("drop schema public cascade"))
        link.execute(sql.text("create schema public"))
    engine.dispose()
