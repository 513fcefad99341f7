"""Users, sessions, tokens and shared links: whom a secret stands for, and when it no longer does."""

import hashlib
import sqlite3
from concurrent.futures import ThreadPoolExecutor

import pytest

from campaign.errors import CampaignError, SpecError, StoreError
from clearcap.web.access import Role
from clearcap.web.access.database import Database
from clearcap.web.access.users import IDLE, LINK_LIVES, LONGEST_SESSION, Sessions, Tokens, Users, hash_password

PASSWORD = "correct horse battery"


@pytest.fixture
def database(tmp_path):
    made = Database(tmp_path / "service.sqlite")
    yield made
    made.close()


@pytest.fixture
def users(database):
    made = Users(database)
    made.add("ada", Role.ADMIN, PASSWORD)
    made.add("eva", Role.ENGINEER)
    return made


@pytest.fixture
def clock(monkeypatch):
    """Return what moves the time of sessions and tokens on."""
    now = [1e9]
    monkeypatch.setattr("clearcap.web.access.users.time.time", lambda: now[0])

    def move(seconds):
        now[0] += seconds

    return move


def test_database_is_private(database):
    assert database.path.stat().st_mode & 0o777 == 0o600


def test_later_database_is_refused(tmp_path):
    connection = sqlite3.connect(tmp_path / "x")
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(SpecError, match="has version 99"):
        Database(tmp_path / "x")


def test_other_file_is_refused(tmp_path):
    (tmp_path / "x").write_bytes(b"no database at all" * 100)
    with pytest.raises(SpecError, match="is not the database"):
        Database(tmp_path / "x")


def test_failed_write_leaves_nothing(database):
    users = Users(database)

    def add_and_fail():
        with database.write() as connection:
            connection.execute("INSERT INTO users (name, role, created) VALUES ('x', 'viewer', 0)")
            raise KeyError

    with pytest.raises(KeyError):
        add_and_fail()
    assert users.all() == []


def test_full_disk_is_said_and_passes(users, database):
    """What was written stays, nothing is half written, and with room again all goes on."""
    pages = database.row("PRAGMA page_count")[0]
    users.add("first", Role.VIEWER)
    with database.write() as connection:
        connection.execute(f"PRAGMA max_page_count = {pages}")
    begun = Sessions(database)
    secrets = []

    def fill():
        while True:
            secrets.append(begun.begin("first"))

    with pytest.raises(StoreError, match=r"\bfull\b"):
        fill()
    assert all(begun.principal(secret) for secret in secrets)
    assert users.get("first") is not None
    with database.write() as connection:
        connection.execute(f"PRAGMA max_page_count = {pages + 100}")
    assert begun.principal(begun.begin("first")) is not None


def test_who_reads_is_known_while_nothing_can_be_written(users, database, clock):
    """Another process holds the file, as a backup: that somebody asked is not noted, and he is answered at once."""
    held, begun = Tokens(database), Sessions(database)
    secret, session = held.add("eva", "night", Role.VIEWER, 3600.0)[1], begun.begin("eva")
    clock(1000.0)
    other = sqlite3.connect(database.path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    assert (held.principal(secret).name, begun.principal(session).name) == ("eva", "eva")
    assert held.all()[0].used is None
    other.execute("ROLLBACK")
    other.close()
    held.principal(secret)
    assert held.all()[0].used == 1e9 + 1000.0


def test_fault_of_a_statement_is_none_of_the_disk(database):
    for ask in (database.rows, database.row):
        with pytest.raises(sqlite3.OperationalError, match="no such table"):
            ask("SELECT 1 FROM no_table")


def test_reading_does_not_wait_for_writing(users, database):
    """Who is asked for is known while another thread's write takes its time; what it writes is seen afterwards."""
    with database.write() as connection:
        connection.execute("UPDATE users SET role = 'viewer' WHERE name = 'eva'")
        with ThreadPoolExecutor(1) as other:
            assert other.submit(users.get, "eva").result(5.0).role is Role.ENGINEER
    assert users.get("eva").role is Role.VIEWER
    with pytest.raises(StoreError, match="readonly"):
        database.rows("DELETE FROM users")


def test_password_is_hashed_with_much_work(cheap_passwords, monkeypatch):
    """By scrypt, with 32 MiB."""
    monkeypatch.setattr("clearcap.web.access.users._COST", cheap_passwords)
    name, salt, kept = hash_password(PASSWORD).split("$")
    expected = hashlib.scrypt(PASSWORD.encode(), salt=bytes.fromhex(salt), n=2**15, r=8, p=1, maxmem=64 << 20, dklen=32)
    assert (name, kept) == ("scrypt", expected.hex())


def test_password(users):
    assert users.by_password("ada", PASSWORD).role is Role.ADMIN
    assert users.by_password("ada", PASSWORD + "x") is None
    assert users.by_password("eva", "") is None  # she has none
    assert users.by_password("nobody", PASSWORD) is None


def test_passwords_are_not_kept(users, database):
    row = database.row("SELECT password FROM users WHERE name = 'ada'")
    assert PASSWORD not in row["password"]


@pytest.mark.parametrize("name", ["", "a b", "../x", "x" * 65, "-x", "ada\n", "<b>"])
def test_name_is_refused(users, name):
    with pytest.raises(SpecError, match="allowed: 1 to 64 letters"):
        users.add(name, Role.VIEWER)


def test_name_is_taken(users):
    with pytest.raises(CampaignError, match="a user of this name exists already"):
        users.add("ada", Role.VIEWER)


def test_short_password_is_refused(users):
    with pytest.raises(SpecError, match=r"\b5 characters.*\b12\b"):
        users.change("eva", password="short")


def test_last_admin_stays(users):
    for change in ({"role": Role.VIEWER}, {"disabled": True}):
        with pytest.raises(CampaignError, match="is the last admin"):
            users.change("ada", **change)
    assert users.get("ada").role is Role.ADMIN
    users.change("eva", role=Role.ADMIN)
    assert users.change("ada", disabled=True).is_disabled


def test_session(users, database, clock):
    made = Sessions(database)
    secret = made.begin("eva")
    principal = made.principal(secret)
    assert (principal.name, principal.role, principal.kind) == ("eva", Role.ENGINEER, "session")
    assert principal.may(Role.VIEWER)
    assert not principal.may(Role.APPROVER)
    made.end(secret)
    assert made.principal(secret) is None


def test_secrets_are_not_kept(users, database):
    secrets = [Sessions(database).begin("eva"), Sessions(database).new_link("eva")]
    secrets.append(Tokens(database).add("eva", "ci", Role.VIEWER, 60.0)[1])
    secrets.append(Tokens(database).share("c", "eva", "", 60.0)[1])
    dumped = b"".join(path.read_bytes() for path in database.path.parent.glob("service.sqlite*"))
    assert [secret for secret in secrets if secret.encode() in dumped] == []
    assert b"eva" in dumped


def test_idle_session_ends(users, database, clock):
    made = Sessions(database)
    secret = made.begin("eva")
    for _ in range(5):
        clock(IDLE - 1.0)
        assert made.principal(secret) is not None
    clock(IDLE + 1.0)
    assert made.principal(secret) is None


def test_session_ends_after_a_week(users, database, clock):
    made = Sessions(database)
    secret = made.begin("eva")
    ended = 0.0
    while made.principal(secret) is not None:
        clock(3600.0)
        ended += 3600.0
    assert ended == pytest.approx(LONGEST_SESSION, abs=3600.0)


def test_disabled_user_is_nobody(users, database):
    secret = Sessions(database).begin("eva")
    _, token = Tokens(database).add("eva", "ci", Role.ENGINEER, 60.0)
    users.change("eva", disabled=True)
    assert Sessions(database).principal(secret) is None
    assert Tokens(database).principal(token) is None


def test_new_password_ends_sessions(users, database):
    secret = Sessions(database).begin("eva")
    users.change("eva", password=PASSWORD)
    assert Sessions(database).principal(secret) is None


def test_link_is_used_once(users, database, clock):
    made = Sessions(database)
    secret = made.new_link("eva")
    assert made.use_link(secret) == "eva"
    assert made.use_link(secret) is None
    late = made.new_link("eva")
    clock(LINK_LIVES + 1.0)
    assert made.use_link(late) is None


def test_token(users, database, clock):
    made = Tokens(database)
    _, secret = made.add("eva", "ci", Role.ADMIN, 60.0)
    assert made.principal(secret).role is Role.ENGINEER  # never more than its user
    assert made.principal(secret + "x") is None
    clock(61.0)
    assert made.principal(secret) is None
    _, secret = made.add("eva", "ci", Role.VIEWER, 60.0)
    assert made.principal(secret).role is Role.VIEWER
    made.revoke(made.all("eva")[0].id)
    assert made.principal(secret) is None
    assert [each.name for each in made.all()] == ["ci", "ci"]


def test_share(users, database, clock):
    made = Tokens(database)
    share, secret = made.share("demo-1", "eva", "for the customer", 60.0)
    principal = made.principal(secret)
    assert (principal.role, principal.campaign) == (Role.VIEWER, "demo-1")
    assert principal.may_see("demo-1")
    assert not principal.may_see("demo-2")
    session = Sessions(database).begin(share=share.id)
    assert Sessions(database).principal(session).campaign == "demo-1"
    assert not made.revoke_share("demo-2", share.id)
    assert made.revoke_share("demo-1", share.id)
    assert made.principal(secret) is None
    assert Sessions(database).principal(session) is None


def test_share_expires(users, database, clock):
    made = Tokens(database)
    share, secret = made.share("demo-1", "eva", "", 60.0)
    session = Sessions(database).begin(share=share.id)
    clock(61.0)
    assert made.principal(secret) is None
    assert Sessions(database).principal(session) is None
