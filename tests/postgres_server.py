"""A PostgreSQL server of its own, from the system's packages, on loopback only."""

import os
import shutil
import socket
import subprocess
import tempfile
from contextlib import contextmanager
from pathlib import Path


class Absent(Exception):
    """Why there is no server."""


@contextmanager
def server():
    """URL of an empty database, while it runs; `Absent` with a reason where there is none."""
    try:
        import psycopg  # noqa: F401
    except ImportError:
        raise Absent("irbcal[postgres] is not installed") from None
    places = [
        Path(shutil.which("initdb") or "/").parent,
        *sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True),
    ]
    binaries = next((place for place in places if (place / "initdb").is_file()), None)
    if binaries is None:
        raise Absent("PostgreSQL is not installed (Debian: postgresql)")
    as_user = []
    place = Path(tempfile.mkdtemp(prefix="irbcal-postgres-", dir="/tmp"))  # other temporary folders may be root's alone
    try:
        if os.geteuid() == 0:
            if not shutil.which("setpriv"):
                raise Absent("PostgreSQL does not run as root, and there is no setpriv")
            as_user = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
            os.chown(place, 65534, 65534)
        yield from _running(place, binaries, as_user)
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _running(place, binaries, as_user):
    data = place / "data"
    command = [binaries / "initdb", "-D", data, "-U", "irbcal", "--auth=trust", "--no-sync", "-E", "UTF8", "--locale=C"]
    made = subprocess.run([*as_user, *command], capture_output=True, text=True, cwd="/")
    if made.returncode:
        raise Absent(f"initdb failed: {made.stderr.strip().splitlines()[-1]}")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories= -c fsync=off"
    control = [*as_user, str(binaries / "pg_ctl"), "-D", str(data)]
    log = ["-l", str(place / "log")]
    subprocess.run([*control, *log, "-o", options, "-w", "start"], check=True, capture_output=True, cwd="/")
    try:
        yield f"postgresql+psycopg://irbcal@127.0.0.1:{port}/postgres"
    finally:
        subprocess.run([*control, "-m", "immediate", "stop"], check=True, capture_output=True, cwd="/")


def emptied(url):
    """The database without tables."""
    import sqlalchemy as sql

    engine = sql.create_engine(url)
    with engine.begin() as link:
        link.execute(sql.text("drop schema public cascade"))
        link.execute(sql.text("create schema public"))
    engine.dispose()
