"""The page of exports: its address has what the form says, and the commands that it shows do the same."""

import io
import re
import urllib.request
from html import unescape

import pyarrow as pa
import pytest

from clearcap.questions.exported_rows import FORMATS

pytestmark = pytest.mark.processes


@pytest.mark.parametrize("kind", FORMATS)
def test_lines_do_what_the_page_does(visit, explored, computing, monkeypatch, kind):
    """The link, the curl command and the Python lines ask for the same; the lines run and have the rows."""
    text = visit(f"/campaigns/{explored[0]}/export?format={kind}&columns=FC-1+sample&first=3&last=7&status=ok").text
    link = unescape(re.search(r'class="button" href="([^"]+)"', text)[1])
    lines = unescape(re.search(r'aria-label="The Python lines">([^<]+)<', text)[1])
    curl = unescape(re.search(r'aria-label="The curl command">([^<]+)<', text)[1])
    assert link in curl
    client, headers = computing

    def opened(request):
        assert request.full_url.endswith(link)
        assert request.get_header("Authorization") == "Bearer x"
        return io.BytesIO(client.get(link, headers=headers("viewer")).content)

    monkeypatch.setattr(urllib.request, "urlopen", opened)
    monkeypatch.setenv("CLEARCAP_TOKEN", "x")
    found: dict[str, pa.Table] = {}
    exec(lines, found)
    assert found["rows"]["sample"].to_pylist() == [3, 4, 5, 6, 7]


def test_files(visit, explored):
    text = visit(f"/campaigns/{explored[0]}/export", "viewer").text
    assert f"/api/v1/campaigns/{explored[0]}/campaign.toml" in text
    visit(f"/campaigns/{explored[0]}/export?format=xls", status=422)
