"""Where a token may be sent."""

import pytest

from campaign.client.server_address import checked_address, checked_token
from campaign.errors import SpecError
from tests.each import each


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("https://clearcap.example/", "https://clearcap.example"),
        ("https://clearcap.example:8443", "https://clearcap.example:8443"),
        ("http://127.0.0.1:8700", "http://127.0.0.1:8700"),
        ("http://localhost:8700", "http://localhost:8700"),
        ("http://[::1]:8700/", "http://[::1]:8700"),
    ],
)
def test_addresses(url, address):
    assert checked_address(url) == address


@each(
    ("url", "fault"),
    [
        ("http://clearcap.example", "over http others read the token"),
        ("http://127.0.0.1.example", "over http others read the token"),
        ("http://10.0.0.1:8700", "over http others read the token"),
        ("https://eva:pass@clearcap.example", "holds more than a host"),
        ("https://clearcap.example/?token=secret", "holds more than a host"),
        ("ftp://clearcap.example", "not the address of a server"),
        ("clearcap.example", "not the address of a server"),
        ("https://clearcap.example/api", "not the address of a server"),
        ("https://clearcap.example:port", "not an address"),
    ],
)
def test_refused_addresses(url, fault):
    with pytest.raises(SpecError, match=fault) as refused:
        checked_address(url)
    assert "pass" not in str(refused.value)
    assert "secret" not in str(refused.value)


def test_tokens(monkeypatch):
    monkeypatch.delenv("CLEARCAP_TOKEN", raising=False)
    with pytest.raises(SpecError, match="CLEARCAP_TOKEN"):
        checked_token(None)
    monkeypatch.setenv("CLEARCAP_TOKEN", "clearcap_token_1\n")
    assert checked_token(None) == "clearcap_token_1"
    with pytest.raises(SpecError, match="copy it once more") as refused:
        checked_token("clearcap_token_ä")
    assert "ä" not in str(refused.value)
