"""Databases for tests of the lab: SQLite in a folder, and a real PostgreSQL of the system's, started and ended here."""

import contextlib
import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from pathlib import Path

import pytest

from sonospline.lab import AttemptRecord, ResultStore

REQUIRED = os.environ.get("SONOSPLINE_REQUIRE_POSTGRESQL") == "1"


def _programs():
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/pg_ctl"))
    return found[-1].parent if found else None


def absent(what):
    if REQUIRED:
        pytest.fail(f"{what}, and SONOSPLINE_REQUIRE_POSTGRESQL is set")
    pytest.skip(what)


def _as_somebody(folder):
    """How to run its programs, which refuse root: as the user that Debian made, to whom the folder is given."""
    if os.geteuid() != 0:
        return []
    try:
        user = pwd.getpwnam("postgres")
    except KeyError:
        absent("postgresql refuses root, and there is no user postgres")
    os.chown(folder, user.pw_uid, user.pw_gid)
    return ["runuser", "-u", "postgres", "--"]


@contextlib.contextmanager
def postgresql():
    """A server on a free port of this machine, in a folder of its own; yields the port."""
    programs = _programs()
    if programs is None:
        absent("postgresql is not installed (Debian: apt install postgresql)")
    folder = Path(tempfile.mkdtemp(prefix="sonospline-postgresql-", dir="/tmp"))  # pytest's are closed to others
    somebody, data = _as_somebody(folder), folder / "data"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    def run(*words):
        done = subprocess.run([*somebody, *map(str, words)], cwd="/", capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stdout + done.stderr

    run(programs / "initdb", "-D", data, "-U", "lab", "-A", "trust", "--no-sync", "-E", "UTF8")
    options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories= -c fsync=off"
    run(programs / "pg_ctl", "-D", data, "-w", "-l", folder / "log", "-o", options, "start")
    try:
        yield port
    finally:
        run(programs / "pg_ctl", "-D", data, "-w", "-m", "immediate", "stop")
        shutil.rmtree(folder)


def fresh(port, name):
    """The address of an empty database."""
    import pg8000.dbapi

    connection = pg8000.dbapi.connect(user="lab", host="127.0.0.1", port=port, database="postgres")
    connection.autocommit = True
    connection.cursor().execute(f'CREATE DATABASE "{name}"')
    connection.close()
    return f"postgresql+pg8000://lab:secret@127.0.0.1:{port}/{name}"


def record(exercise="Vessel", passed=True, **values):
    metrics = {"final_error_mm": 1.5, "blind_advance_mm": 0.0, "passes": 1.0}
    return AttemptRecord(
        exercise, "a1", 3, "on target", passed, "passed" if passed else "not yet", 41.0, metrics, **values
    )


def write_as_a_station(address, number, count):
    with ResultStore(address) as store:
        store.add_participant(f"S-{number}", group="one for all")
        for k in range(count):
            store.add(f"S-{number}", record(passed=bool(k % 2)), session="at once")
