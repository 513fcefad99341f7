"""Pages as whoever came by a shared link sees them: everything that they offer can be opened."""

from html.parser import HTMLParser
from urllib.parse import urljoin, urlsplit

import pytest

from clearcap.web.http.authentication import SHARE_COOKIE

pytestmark = pytest.mark.processes

TABS = {"Progress", "Report", "Samples", "What if", "Export", "Sign-off"}
MOST = 200  # addresses that the pages of a campaign of four samples lead to


class Offered(HTMLParser):
    """What a page leads to: the addresses of links, pictures, frames and forms that only ask; and its tabs."""

    def __init__(self, text):
        super().__init__()
        self.addresses, self.writes, self.tabs = set(), set(), set()
        self._in_tabs = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        """Note an address."""
        given = dict(attrs)
        for name in ("href", "src", "hx-get", "data-events"):
            if name in given:
                self.addresses.add(given[name])
        if tag == "form":
            (self.writes if given.get("method") == "post" else self.addresses).add(given["action"])
        if tag == "nav":
            self._in_tabs = given.get("class") == "tabs"

    def handle_endtag(self, tag):
        """Note the end of the tabs."""
        if tag == "nav":
            self._in_tabs = False

    def handle_data(self, data):
        """Note the name of a tab."""
        if self._in_tabs and data.strip():
            self.tabs.add(data.strip())


@pytest.fixture
def guest(computing, computing_service, explored):
    """Return a browser that came by a link to the campaign with real runs, and that campaign's id."""
    client, _ = computing
    service, _ = computing_service
    campaign = explored[2]
    _, secret = service.tokens.share(campaign, "engineer", "", 600.0)
    entered = client.get(f"/shared/{secret}", headers={"Accept": "text/html"})
    assert entered.status_code == 200
    assert SHARE_COOKIE in client.cookies
    return client, campaign


def test_every_address_opens(guest):
    """From tab to tab, page to page and file to file, nothing is refused or missing."""
    client, campaign = guest
    start = f"/campaigns/{campaign}"
    shown = client.get(start, headers={"Accept": "text/html"})
    assert Offered(shown.text).tabs == TABS
    refused, asked, waiting = {}, set(), [start]
    while waiting:
        address = waiting.pop()
        asked.add(address)
        answer = client.get(address, headers={"Accept": "text/html"})
        if answer.status_code >= 400:
            refused[address] = answer.status_code
        elif answer.headers.get("content-type", "").startswith("text/html") and "/reports/" not in address:
            page = Offered(answer.text)
            assert page.writes <= {"/logout"}, address
            found = {urljoin(address, each) for each in page.addresses if not urlsplit(each).scheme}
            waiting += sorted({each.partition("#")[0] for each in found} - asked - set(waiting))
        assert len(asked) < MOST
    assert refused == {}
    assert {address.partition("?")[0].rpartition("/")[2] for address in asked} >= {
        "samples",
        "whatif",
        "export",
        "signoff",
    }


def test_others_are_refused_in_words(guest, explored):
    """An address that somebody types shows why it is refused; the page's own name leads back to the campaign."""
    client, campaign = guest
    for address in (
        "/campaigns",
        f"/campaigns/{campaign}/compare",
        f"/campaigns/{explored[0]}",
        "/mechanisms",
        "/admin",
    ):
        answer = client.get(address, headers={"Accept": "text/html"})
        assert answer.status_code in (403, 404), address
        assert f'href="/campaigns/{campaign}"' in answer.text


def test_users_have_the_tab(computing, explored):
    client, headers = computing
    shown = client.get(f"/campaigns/{explored[2]}", headers=headers("viewer")).text
    assert Offered(shown).tabs == TABS | {"Compare", "Pool", "Measured lots"}
