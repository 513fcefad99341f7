"""Where a server may listen, and who gets the first link."""

import asyncio
from dataclasses import replace

import pytest

from campaign.errors import SpecError, StoreError
from clearcap.web.server import SECRET, check_settings, first_login, http_server, login_link, read_configuration
from clearcap.web.settings import Limits, Settings
from clearcap.web.web_service import open_service


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "::", "clearcap.example"])
def test_other_machines_need_tls(tmp_path, host):
    with pytest.raises(SpecError, match="--https-cert"):
        check_settings(Settings("runs", tmp_path, host))
    check_settings(Settings("runs", tmp_path, host, behind_proxy=True))
    check_settings(Settings("runs", tmp_path, host, https=(tmp_path / "cert", tmp_path / "key")))


def test_a_proxy_is_an_address(tmp_path):
    check_settings(Settings("runs", tmp_path, behind_proxy=True, proxies=("10.0.0.0/8", "::1")))
    for proxy in ("*", "proxy.example", "10.0.0.1/8"):
        with pytest.raises(SpecError, match="--proxy"):
            check_settings(Settings("runs", tmp_path, behind_proxy=True, proxies=(proxy,)))


def test_only_the_proxy_says_who_asks(settings):
    """What a stranger writes into X-Forwarded-For is not believed; nobody is where no proxy is said to be."""
    for proxies, seen in ((("127.0.0.1",), "9.9.9.9"), (("10.0.0.1",), "127.0.0.1")):
        service = open_service(replace(settings, behind_proxy=True, proxies=proxies))
        assert client_of(http_server(service).config.loaded_app, "127.0.0.1", "9.9.9.9") == seen
        service.close()


def client_of(app, address, forwarded):
    """Return the address from which a proxy's middleware says that a request came."""
    found = []

    async def inner(scope, receive, send):
        found.append(scope["client"][0])

    app.app = inner
    headers = [(b"x-forwarded-for", forwarded.encode()), (b"x-forwarded-proto", b"https")]
    asyncio.run(app({"type": "http", "client": (address, 1), "headers": headers, "scheme": "http"}, None, None))
    return found[0]


def test_data_that_cannot_be_written_are_one_message(tmp_path):
    """Also on a disk that has become read-only: there it is another error of the system's."""
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match="--data"):
        open_service(Settings(str(tmp_path / "runs"), tmp_path / "file/data"))


def test_first_link_makes_the_admin(tmp_path):
    service = open_service(Settings(str(tmp_path / "runs"), tmp_path / "data"))
    assert login_link(service).startswith("http://127.0.0.1:8700/login/link?key=clearcap_login_")
    assert [(user.name, user.role.word) for user in service.users.all()] == [("admin", "admin")]
    with pytest.raises(SpecError, match=r"\badmin\b"):
        login_link(service, "eva")
    service.close()


def test_first_login(tmp_path):
    """What is printed may be kept in a log: only a terminal gets the link, and only at the first start."""
    for is_terminal in (True, False):
        service = open_service(Settings(str(tmp_path / "runs"), tmp_path / f"{is_terminal}"))
        link, file = first_login(service, is_terminal=is_terminal)
        assert (link is None, file is None) == (not is_terminal, is_terminal)
        if file is not None:
            assert file.stat().st_mode & 0o777 == 0o600
            link = file.read_text().strip()
        assert service.sessions.user_of_link(link.partition("key=")[2]) == "admin"
        assert first_login(service, is_terminal=True) == (None, None)
        assert file is None or not file.exists()
        service.close()


def test_data_folder_is_private(tmp_path):
    open_service(Settings(str(tmp_path / "runs"), tmp_path / "data")).close()
    assert (tmp_path / "data").stat().st_mode & 0o777 == 0o700


def test_configuration(tmp_path, monkeypatch):
    path = tmp_path / "serve.toml"
    path.write_text(
        "[limits]\njobs = 4\njob_seconds = 10\n[webhooks]\nallow = ['mes.plant']\n[signing]\nfour_eyes = true\n"
        "[oidc]\nissuer = 'https://id.example'\nclient_id = 'c'\n"
    )
    with pytest.raises(SpecError, match=SECRET):
        read_configuration(path)
    monkeypatch.setenv(SECRET, "s3cret")
    found = read_configuration(path)
    oidc = found["oidc"]
    assert (found["webhook_hosts"], found["four_eyes"]) == (("mes.plant",), True)
    assert found["limits"] == Limits(jobs=4, job_seconds=10.0)
    assert replace(Settings("runs", tmp_path), **found).oidc is oidc
    assert (oidc.issuer, oidc.client_secret) == ("https://id.example", "s3cret")
    assert "s3cret" not in repr(oidc)
    assert read_configuration(None) == {}


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("[limits]\njbs = 4\n", "limits.jbs: no such limit"),
        ("[limits]\njobs = 0\n", "limits.jobs"),
        ("[oidc]\nissuer = 'http://id.example'\nclient_id = 'c'\n", "oidc.issuer"),
        ("[oidc]\nissuer = 'https://id.example'\nclient_id = 'c'\nroles = {a = 'king'}\n", "oidc.roles.a"),
        ("[webhooks]\nallow = ['http://x/']\n", "webhooks.allow"),
        ("jobs = 4\n", "jobs"),
        ("[signing]\nfour_eyes = 1\n", "signing.four_eyes"),
        ("x = ", "cannot be read"),
    ],
)
def test_configuration_fault(tmp_path, monkeypatch, text, fault):
    monkeypatch.setenv(SECRET, "s3cret")
    (tmp_path / "serve.toml").write_text(text)
    with pytest.raises(SpecError, match=fault):
        read_configuration(tmp_path / "serve.toml")
