"""Backups of a server: what was acknowledged is in them, whatever happens meanwhile; what is damaged is refused."""

import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress

import pytest

from campaign.errors import SpecError
from clearcap.web.access import Role
from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.database import DATABASE, SCHEMA, VERSIONS, Database
from clearcap.web.access.users import Users
from clearcap.web.maintenance import KEY_FILE, back_up, check_backup, restore
from tests.counts import some
from tests.until import until

PASSPHRASE = "a sentence that is long"


@pytest.fixture
def data(tmp_path):
    """Return the folder of a server with a user, a key and an audit trail."""
    folder = tmp_path / "data"
    folder.mkdir(0o700)
    (folder / KEY_FILE).write_text("a key")
    with closing(Database(folder / DATABASE)) as database:
        Users(database).add("ada", Role.ADMIN)
        AuditTrail(database).add("ada", "session", "::1", "POST /x", "y", 201)
    return folder


def entries(folder):
    """Return the number of entries of the audit trail in a folder; they must be whole."""
    with closing(Database(folder / DATABASE)) as database:
        trail = AuditTrail(database)
        assert trail.first_fault() is None
        return len(trail.newest(count=10**6))


@pytest.mark.parametrize("passphrase", [None, PASSPHRASE])
def test_there_and_back(data, tmp_path, passphrase):
    """Private, with all that was there, also encrypted; nothing is replaced."""
    file, target = tmp_path / "b", tmp_path / "new" / "data"
    made = back_up(data, file, 1.0, passphrase)
    assert (made.users, made.audit, made.signoffs) == (1, 1, 0)
    assert file.stat().st_mode & 0o777 == 0o600
    assert (file.read_bytes()[:2] == b"PK") == (passphrase is None)
    assert check_backup(file, passphrase) == restore(file, target, passphrase) == made
    assert [path.stat().st_mode & 0o777 for path in (target, target / KEY_FILE, target / DATABASE)] == [
        0o700,
        0o600,
        0o600,
    ]
    assert ((target / KEY_FILE).read_text(), entries(target)) == ("a key", 1)
    for again in (lambda: back_up(data, file, 1.0), lambda: restore(file, target, passphrase)):
        with pytest.raises(SpecError, match=r"exists|not empty"):
            again()
    assert sorted(path.name for path in data.parent.iterdir()) == ["b", "data", "new"]


def test_each_damage_is_found(data, tmp_path):
    """A byte changed or cut off anywhere, another passphrase, none."""
    plain, secret = tmp_path / "plain", tmp_path / "secret"
    back_up(data, plain, 1.0)
    back_up(data, secret, 1.0, PASSPHRASE)
    said = check_backup(plain)
    for file, passphrase in ((plain, None), (secret, PASSPHRASE)):
        content = file.read_bytes()
        for place in some(range(0, len(content), 50)):
            file.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
            with suppress(SpecError):
                assert check_backup(file, passphrase) == said  # a bit that means nothing, as of a time in the archive
            file.write_bytes(content[:place])
            with pytest.raises(SpecError):
                check_backup(file, passphrase)
        file.write_bytes(content)
    for wrong in (None, "another sentence"):
        with pytest.raises(SpecError, match=r"encrypted|decrypted"):
            check_backup(secret, wrong)


def test_backup_while_others_write(data, tmp_path):
    """Each entry that was acknowledged before a backup began is in it, and each backup is whole."""
    acknowledged, over, faults = [1], threading.Event(), []

    def write():
        try:
            with closing(Database(data / DATABASE)) as database:
                while not over.is_set():
                    acknowledged.append(AuditTrail(database).add("ada", "session", "::1", "POST /x", "y", 201).number)
        except Exception as error:
            faults.append(error)

    writers = [threading.Thread(target=write) for _ in range(2)]
    for writer in writers:
        writer.start()
    try:
        for number in range(5):
            until(lambda number=number: len(acknowledged) > 20 * number or faults, "they write")
            before = max(acknowledged)
            back_up(data, tmp_path / f"{number}", 1.0)
            restore(tmp_path / f"{number}", tmp_path / f"of{number}")
            assert entries(tmp_path / f"of{number}") >= before
    finally:
        over.set()
        for writer in writers:
            writer.join()
    assert not faults


KILLED = """
import sys
from pathlib import Path
from clearcap.web.maintenance import back_up, restore
data, file, target = map(Path, sys.argv[1:])
print("ready", flush=True)
for number in range(10**6):
    back_up(data, file.with_name(f"{file.name}{number}"), 1.0)
    restore(file.with_name(f"{file.name}{number}"), target.with_name(f"{target.name}{number}"))
"""


@pytest.mark.slow
@pytest.mark.processes
def test_killed_in_the_middle(data, tmp_path):
    """What has its name is whole: no half backup, no half folder; and the server's own data stay."""
    for round_ in range(12):
        place = tmp_path / f"round{round_}"
        place.mkdir()
        words = [sys.executable, "-c", KILLED, data, place / "backup", place / "folder"]
        with subprocess.Popen(list(map(str, words)), stdout=subprocess.PIPE, text=True) as process:
            process.stdout.readline()
            until((place / "folder0").exists, "one round", pause=0.01)
            time.sleep(0.013 * round_)  # so that each round is killed elsewhere
            process.send_signal(signal.SIGKILL)
        for path in place.iterdir():
            if path.name.startswith("backup"):
                assert check_backup(path).audit == 1
            elif path.name.startswith("folder"):
                assert entries(path) == 1
        assert entries(data) == 1


def test_upgrade_keeps_a_copy(tmp_path):
    """An earlier clearcap can go on with it, as it refuses the upgraded file."""
    path = tmp_path / DATABASE
    with closing(sqlite3.connect(path, isolation_level=None)) as earlier:
        earlier.executescript(SCHEMA)
        earlier.execute("INSERT INTO users (name, role, created) VALUES ('ada', 'admin', 0)")
        earlier.execute("PRAGMA user_version = 1")
    with closing(Database(path)) as database:
        assert database.row("PRAGMA user_version")[0] == len(VERSIONS)
    kept = tmp_path / f"{DATABASE}.version-1"
    assert kept.stat().st_mode & 0o777 == 0o600
    with closing(sqlite3.connect(kept)) as copied:
        assert copied.execute("PRAGMA user_version").fetchone() == (1,)
        assert copied.execute("SELECT name FROM users").fetchall() == [("ada",)]
    os.replace(kept, path)
    with closing(Database(path)) as database:
        assert Users(database).get("ada") is not None
