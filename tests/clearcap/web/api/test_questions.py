"""Questions to rows over the API: the command's documents, to the last bit; who may ask, and what is wrong."""

import json

import pytest
from typer.testing import CliRunner

from clearcap.cli import app
from clearcap.web.jobs.queries import MOST_SETTINGS

pytestmark = [pytest.mark.processes, pytest.mark.bits]

NARROWER = "J1.std=0.018"
COSTS = "[variables.J1]\ncost = 1.0\n[variables.preload]\ncost = 2.0\n"


@pytest.fixture
def ask(computing, explored):
    """Return what asks the campaign of 400 samples as a viewer, and gives the answer."""
    client, headers = computing

    def asked(path, method="get", role="viewer", campaign=explored[1], **options):
        return client.request(method, f"/api/v1/campaigns/{campaign}/{path}", headers=headers(role), **options)

    return asked


@pytest.fixture
def said(computing_service, explored):
    """Return the document that the command prints of the same."""
    store = computing_service[0].store.url
    return lambda verb, *words: json.loads(
        CliRunner().invoke(app, [verb, explored[1], *words, "--store", store, "--json"]).stdout
    )


def test_what_if_is_the_commands(ask, said):
    """The numbers of the page's call, by address or by body, are those of the command to the bit."""
    answer = ask("whatif", params={"set": [NARROWER, "preload.upper=0.99"]})
    assert answer.status_code == 200, answer.text
    assert answer.json() == said("whatif", "--set", NARROWER, "--set", "preload.upper=0.99")
    found = ask("whatif", "post", json={"set": [NARROWER]}).json()
    assert found == said("whatif", "--set", NARROWER)
    assert found["responses"]["FC-1"]["mean"]["value"] > 0


def test_what_if_that_the_client_has(ask, computing):
    tag = ask("whatif", params={"set": NARROWER}).headers["etag"]
    client, headers = computing
    request = client.build_request("GET", ask("whatif", params={"set": NARROWER}).url)
    again = client.get(request.url, headers={**headers("viewer"), "If-None-Match": tag})
    assert again.status_code == 304


def test_advice_and_costs_are_the_commands(ask, said, tmp_path):
    (tmp_path / "costs.toml").write_text(COSTS)
    assert ask("advice").json() == said("advise")
    answer = ask("allocation", "post", json={"costs": COSTS})
    assert answer.json() == said("advise", "--cost", str(tmp_path / "costs.toml"))


def test_histogram(ask):
    found = ask("histogram", params={"response": "FC-1", "set": NARROWER}).json()
    assert len(found["edges"]) == len(found["before"]) + 1
    assert sum(found["after"]) == pytest.approx(400)
    assert sum(found["before"]) == 400


def test_comparison(ask, explored):
    """Of one campaign with another; not with itself, and not with what is not there."""
    found = ask(f"comparisons/{explored[0]}").json()["comparison"]
    assert found["campaign"] == explored[0]
    assert found["responses"][0]["mean_interval"][0] <= found["responses"][0]["mean_interval"][1]
    assert ask(f"comparisons/{explored[1]}").status_code == 422
    assert ask("comparisons/none").status_code == 404


@pytest.mark.parametrize(
    ("path", "options"),
    [
        ("whatif", {}),
        ("whatif", {"params": {"set": "J9.std=1"}}),
        ("whatif", {"params": {"set": "J1.std=" + "9" * 1001}}),
        ("whatif", {"params": {"set": [NARROWER] * (MOST_SETTINGS + 1)}}),
        ("histogram", {"params": {"response": "none"}}),
        ("allocation", {"method": "post", "json": {"costs": "[variables.J9]\ncost = 1.0\n"}}),
        ("allocation", {"method": "post", "json": {"costs": "not toml"}}),
    ],
)
def test_odd_questions(ask, path, options):
    answer = ask(path, **options)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


def test_who_may_ask(ask, computing, explored, computing_service):
    """Nobody without a login; a shared link asks what-if of its campaign, and nothing of another."""
    client, _ = computing
    path = f"/api/v1/campaigns/{explored[0]}/whatif"
    assert client.get(path, params={"set": NARROWER}).status_code == 401
    _, secret = computing_service[0].tokens.share(explored[0], "viewer", "", 60.0)
    shared = {"Authorization": f"Bearer {secret}"}
    assert client.get(path, params={"set": NARROWER}, headers=shared).status_code == 200
    other = f"/api/v1/campaigns/{explored[0]}/comparisons/{explored[1]}"
    assert client.get(other, headers=shared).status_code == 403
    assert ask("whatif", campaign="none", params={"set": NARROWER}).status_code == 404
