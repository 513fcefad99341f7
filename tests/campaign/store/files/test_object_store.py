"""A server that takes connections and says nothing is given up in time."""

import pytest
import s3fs

from campaign.errors import StoreError
from campaign.store.files import object_store
from campaign.store.files.files import Files
from campaign.store.files.object_store import ObjectStore, OpenedFileSystem
from campaign.store.files.retry_policy import HASTY, PATIENT, QUICK, RetryPolicy
from tests.campaign.store.files.test_s3 import ACCESS
from tests.campaign.switch import Switch

ONCE = RetryPolicy(0.0, answer=0.4)
OPERATIONS = {
    "read": lambda files: files.read("a/x"),
    "exists": lambda files: files.exists("a/x"),
    "names": lambda files: files.names("a"),
    "stamps": lambda files: files.stamps("a"),
    "write": lambda files: files.write("a/x", b"content"),
    "create": lambda files: files.create("a/x", b"content"),
    "move": lambda files: files.move("a/x", "a/y"),
    "remove": lambda files: files.remove("a/x"),
    "remove_tree": lambda files: files.remove_tree("a"),
}


@pytest.fixture(scope="module")
def silent():
    """Return the URL of a bucket on a server that says nothing."""
    switch = Switch(0)
    switch.keep_silent()
    with pytest.MonkeyPatch.context() as patch:
        for key, value in {**ACCESS, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{switch.port}"}.items():
            patch.setenv(key, value)
        s3fs.S3FileSystem.clear_instance_cache()  # which knows the server of the test before
        yield "s3://bucket/silent"
    switch.refuse()


@pytest.mark.parametrize("name", OPERATIONS)
def test_every_operation_is_given_up(silent, monkeypatch, name):
    """s3fs itself waits for minutes: it tries five times, and for each of these botocore does."""
    monkeypatch.setattr("campaign.store.files.object_store.MANY_FILES", 0.4)
    with pytest.raises(StoreError, match=r"no answer within [01] s"):
        OPERATIONS[name](Files(silent, ONCE))


def test_who_is_in_a_hurry_waits_less():
    """Whoever computes waits as long as an answer may take; whoever must not wait, a few seconds."""
    assert HASTY.answer < QUICK.answer < PATIENT.answer
    assert Files("memory://x", PATIENT).hasty._backend._answer_s == HASTY.answer


def test_a_large_file_may_take_longer(monkeypatch):
    """By the time that its bytes take on a slow connection."""
    allowed = []

    def ask(self, operation, *arguments, seconds, **how):
        allowed.append((operation, seconds))
        return {"type": "file", "size": 10_000_000} if operation == "info" else b""

    monkeypatch.setattr(OpenedFileSystem, "ask", ask)
    store = ObjectStore("memory://x", 8.0)
    store.read("/x", 10**9)
    store.write("/x", b"0" * 20_000_000)
    by_bytes = 1.0 / object_store.SLOWEST
    assert allowed == [("info", 8.0), ("cat_file", 8.0 + 1e7 * by_bytes), ("pipe_file", 8.0 + 2e7 * by_bytes)]


def test_a_folder_is_made_when_it_is_missing(monkeypatch):
    """Once: a fault that remains with the folder there is raised as it is."""
    asked, folders, full = [], set(), False

    def ask(self, operation, path, *content, seconds, **how):
        asked.append(operation)
        if operation == "makedirs":
            folders.add(path)
        elif path.rpartition("/")[0] not in folders:
            raise FileNotFoundError(path)
        elif full:
            raise OSError("no space left")

    monkeypatch.setattr(OpenedFileSystem, "ask", ask)
    store = ObjectStore("memory://x", 8.0)
    store.write("/a/x", b"1")
    store.write("/a/y", b"2")
    assert asked == ["pipe_file", "makedirs", "pipe_file", "pipe_file"]
    full = True
    with pytest.raises(OSError, match="no space left"):
        store.write("/a/z", b"3")
    assert asked[4:] == ["pipe_file"]
