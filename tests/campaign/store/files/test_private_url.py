"""A store's URL is shown, logged and stored without its secrets, whatever they look like."""

import json
import pickle
import traceback
from urllib.parse import quote

import pytest

from campaign.errors import CampaignError, StoreError
from campaign.store.files.files import Files
from campaign.store.files.private_url import PrivateUrl
from campaign.store.files.retry_policy import HASTY
from campaign.worker.messages import CampaignAddress
from tests.each import each

PASSWORD = "S3cretPassw0rd"  # tracebacks quote sources, so tests of them do not spell it out


@each(
    ("full", "shown"),
    [
        ("ftp://alice:S3cret99@host/runs", "ftp://alice:***@host/runs"),
        ("ftp://alice:p%40ss%2Fw0rd@host:2121/runs", "ftp://alice:***@host:2121/runs"),
        ("ftp://alice:p/a@ss#w0rd@host/runs", "ftp://alice:***@host/runs"),
        ("ftp://alice:a:b::c@host/runs", "ftp://alice:***@host/runs"),
        ("s3://KEY:SECRET99@bucket/runs", "s3://KEY:***@bucket/runs"),
        ("simplecache::ftp://u:passw0rd@h/runs", "simplecache::ftp://u:***@h/runs"),
        ("zip://a@b.zip::https://u:passw0rd@h/x", "zip://a@b.zip::https://u:***@h/x"),
        ("https://ghp_0123456789@host/runs", "https://***@host/runs"),
        ("https://h/f?token=abcdef&x=1&sig=xyzzyx::zip", "https://h/f?token=***&x=1&sig=***::zip"),
        ("https://h/f?X-Amz-Date=1&X-Amz-Signature=0a1b", "https://h/f?X-Amz-Date=1&X-Amz-Signature=***"),
        ("abfs://container@account.dfs/runs", "abfs://container@account.dfs/runs"),
        ("sftp://alice@host/runs", "sftp://alice@host/runs"),
        ("ftp://host:21/a@b", "ftp://host:21/a@b"),
        ("ftp://[::1]:21/a@b", "ftp://[::1]:21/a@b"),
        ("s3://bucket/a@b:c", "s3://bucket/a@b:c"),
        ("runs/a:b@c?token=x", "runs/a:b@c?token=x"),
        ("", ""),
    ],
)
def test_what_is_shown(full, shown):
    """Passwords and tokens are hidden, in every link of a chain; users, hosts, ports and paths are not."""
    url = PrivateUrl(full)
    assert (url.shown, str(url), url.has_secrets) == (shown, shown, full != shown)
    assert repr(url) == f"PrivateUrl({shown!r})"
    assert url.redact(f"530 cannot open {full}") == f"530 cannot open {shown}"


@pytest.mark.parametrize("password", ["S3cretPassw0rd", "p@ss/w\"o'r<d>", "grün & geheim"])
def test_every_spelling_is_hidden_and_refused(tmp_path, password):
    """Libraries quote a password in their own ways: as it is, with percent signs, in JSON, in HTML."""
    url = PrivateUrl(f"ftp://alice:{quote(password, safe='')}@host/runs")
    for text in (password, quote(password), quote(password, safe=""), json.dumps(password), f"alice:{password}@host"):
        bare = text.strip('"')
        assert bare not in url.redact(f"login failed for {text} there") or len(password) < 6
        assert url.is_in(f"x {bare} y".encode()) == (len(password) >= 6 or "@host" in text)
    assert not url.is_in(b"alice@host")


@pytest.mark.parametrize("protocol", ["ftp", "nosuch", "memory"])
def test_no_error_quotes_it(protocol):
    """Neither the message of an error nor the traceback with its causes shows a password."""
    with pytest.raises(CampaignError) as caught:
        Files(f"{protocol}://alice:{PASSWORD}@127.0.0.1:1/runs", HASTY).write("a", f"it is {PASSWORD}".encode())
    assert PASSWORD not in "".join(traceback.format_exception(caught.value))
    assert "alice:***@127.0.0.1:1/runs" in str(caught.value)


def test_probe_does_not_quote_it():
    """Checking a store that is not there is an error of the store, without the password."""
    with pytest.raises(StoreError, match=r"ftp://alice:\*\*\*@127\.0\.0\.1:1/runs") as caught:
        Files(f"ftp://alice:{PASSWORD}@127.0.0.1:1/runs").check_writable()
    assert PASSWORD not in "".join(traceback.format_exception(caught.value))


@pytest.mark.parametrize("protocol", ["ftp", "simplecache::ftp"])
def test_no_error_of_an_operation_quotes_it(protocol):
    """A server that is not there, over whatever chain of file systems."""
    files = Files(f"{protocol}://alice:{PASSWORD}@127.0.0.1:1/runs", HASTY)
    for operation in (files.read, files.names, files.remove, files.exists):
        with pytest.raises(StoreError, match=r"alice:\*\*\*@127.0.0.1:1/runs") as caught:
            operation("a")
        assert PASSWORD not in "".join(traceback.format_exception(caught.value))


def test_store_refuses_to_keep_it():
    """The last line of defence: a document that would hold the password is not written."""
    files = Files("memory://alice:S3cretPassw0rd@host/refuse")
    for write in (files.write, files.create):
        with pytest.raises(StoreError, match=r"x/a\b.*password"):
            write("x/a", b'{"store": "S3cretPassw0rd"}')
    assert files.names("x") == []


def test_address_of_a_campaign_does_not_show_it():
    """Workers get the whole URL; what is printed of a task does not have it."""
    address = CampaignAddress("ftp://alice:S3cretPassw0rd@host/runs", "demo-0123456789", "0123456789abcdef")
    assert "S3cret" not in f"{address} {address!r}"
    assert pickle.loads(pickle.dumps(address)).store == "ftp://alice:S3cretPassw0rd@host/runs"
