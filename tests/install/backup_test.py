"""Backup while the daemon works, everything lost, restore: what was done is there with the same bytes, what was not is done.
Then the same data as each released schema had it: the daemon brings them forward and goes on."""

import os
import re
import shutil
import sqlite3
import tempfile

from service import Daemon, arguments, run, skip

options = arguments()
saltus = os.path.join(options.programs, "saltus")
saltusd = os.path.join(options.programs, "saltusd")
backup = os.path.join(options.source, "deploy/operations/saltus-backup")
for program in ("sqlite3", "rsync", "flock"):
    if not shutil.which(program):
        skip(program + " is not installed")


def bytes_of(path):
    with open(path, "rb") as file:
        return file.read()


def released_schemas():
    """The statements that make the tables of each released schema, from the fixtures of the unit tests."""
    path = os.path.join(options.source, "tests/unit/server/store/released_schemas.h")
    fixtures = re.findall(r'kReleasedSchema(\d+) = R"sql\((.*?)\)sql"', bytes_of(path).decode(), re.DOTALL)
    for number, text in fixtures:
        yield int(number), "".join(re.findall(r"^(?:CREATE|PRAGMA).*?;\n", text, re.DOTALL | re.MULTILINE))


def as_schema(statements, version, source, target):
    """The rows of `source` in a database as it was then."""
    old = sqlite3.connect(target)
    old.executescript(statements)
    old.execute("ATTACH ? AS new", (source,))
    tables = "SELECT name FROM main.sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite_%'"
    for (table,) in old.execute(tables).fetchall():
        names = [[row[1] for row in old.execute(f"PRAGMA {schema}.table_info({table})")] for schema in ("main", "new")]
        common = ", ".join(name for name in names[0] if name in names[1])
        old.execute(f"INSERT INTO main.{table} ({common}) SELECT {common} FROM new.{table}")
    old.commit()
    old.execute("DETACH new")
    assert old.execute("PRAGMA main.user_version").fetchone()[0] == version
    assert old.execute("SELECT count(*) FROM main.job").fetchone()[0] == 2
    old.close()


def expect_all_there(data, done, waiting, result, what):
    assert "0 damaged" in run(saltusd, "--data", data, "--fsck"), what
    with Daemon(options, data) as daemon:
        run(saltus, "fetch", done, "--server", daemon.address, "--out", os.path.join(data, "fetched"))
        assert bytes_of(os.path.join(data, "fetched/displacement.mha")) == result, what
        run(saltus, "watch", waiting, "--server", daemon.address)
        assert '"SUCCEEDED"' in run(saltus, "get", waiting, "--server", daemon.address, "--json"), what


with tempfile.TemporaryDirectory() as folder:
    data, copy = os.path.join(folder, "data"), os.path.join(folder, "copy")
    pair = os.path.join(folder, "pair")
    run(saltus, "phantom", "slip", "--size", "40,40", "--out", pair)
    job = ("--fixed", pair + "/fixed.mha", "--moving", pair + "/moving.mha", "--similarity", "ssd", "--preset", "fast",
           "--format", "mha")
    with Daemon(options, data) as daemon:
        run(saltus, "register", "--server", daemon.address, *job, "--out", os.path.join(folder, "result"))
        listed = run(saltus, "list", "--server", daemon.address, "--json")
        done = re.search(r'"id": ?"([^"]+)"', listed).group(1)
        assert run(backup, data, copy).startswith("1 jobs"), "a copy of a daemon at work"
    result = bytes_of(os.path.join(folder, "result/displacement.mha"))

    # A job that runs for as long as the backup takes: its worker waits, and is gone with the daemon.
    worker = os.path.join(folder, "worker")
    with open(worker, "w", encoding="ascii") as file:
        file.write(f"#!/bin/sh\nread -r line < {folder}/never\n")
    os.chmod(worker, 0o700)
    os.mkfifo(os.path.join(folder, "never"))
    with Daemon(options, data, "--worker", worker) as daemon:
        waiting = run(saltus, "submit", "--server", daemon.address, *job).strip()
        stale = os.path.join(copy, "blobs/sha256/ab", 62 * "0")
        os.makedirs(os.path.dirname(stale), exist_ok=True)
        with open(stale, "w", encoding="ascii") as file:
            file.write("of a job that was removed since the last copy")
        told = run(backup, data, copy)
        assert told.startswith("2 jobs"), told
        assert not os.path.exists(stale)
        daemon.crash()
    with open(os.path.join(folder, "never"), "w", encoding="ascii"):
        pass  # The worker's wait ends, and so does it.
    shutil.rmtree(data)

    # A copy that is not whole says so.
    broken = os.path.join(folder, "broken")
    shutil.copytree(copy, broken)
    blob = next(os.path.join(where, names[0]) for where, _, names in os.walk(broken + "/blobs") if names)
    os.remove(blob)
    assert "named by the database and not in the copy" in run(backup, broken, os.path.join(folder, "again"), code=1)
    assert "it has no saltusd.db" in run(backup, folder, os.path.join(folder, "again"), code=2)

    run("rsync", "--archive", "--exclude=.backup-lock", copy + "/", data)
    expect_all_there(data, done, waiting, result, "restored")

    versions = []
    for version, statements in released_schemas():
        old = os.path.join(folder, f"schema-{version}")
        os.mkdir(old)
        shutil.copytree(copy + "/blobs", old + "/blobs")
        as_schema(statements, version, copy + "/saltusd.db", old + "/saltusd.db")
        expect_all_there(old, done, waiting, result, f"schema {version}")
        versions.append(version)
    newest = sqlite3.connect(data + "/saltusd.db").execute("PRAGMA user_version").fetchone()[0]
    assert versions == list(range(1, newest + 1)), versions

    # There is no way back: an older daemon does not touch what a newer one has written.
    database = sqlite3.connect(copy + "/saltusd.db")
    database.execute("PRAGMA user_version = 99")
    database.close()
    assert "use a newer saltusd" in run(saltusd, "--data", copy, code=1)
