"""Campaigns of one plan with other seeds as one report: the page, the calls, and who may."""

import json
import pickle

import pytest
from starlette.concurrency import run_in_threadpool

from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from clearcap.web.jobs.process import compute
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.clearcap.web.pages.forms import Page

KINDS = {
    "first": (SPEC, {}),
    "second": (SPEC, {"seed": 8}),
    "same": (SPEC, {"samples": 30}),
    "other": (SPEC.replace("std = 0.0175", "std = 0.02"), {"seed": 9}),
    "spread": (SPEC.replace("seed = 7", 'seed = 7\nsampler = "sobol"').replace('"demo"', '"spread"'), {"samples": 32}),
}


@pytest.fixture
def ids(client, service, settings, tmp_path, monkeypatch):
    """Return the ids of campaigns of the store by kind; jobs are computed in this process."""
    found = {}
    for kind, (text, changes) in KINDS.items():
        (tmp_path / f"{kind}.toml").write_text(text)
        campaign = load_campaign(str(tmp_path / f"{kind}.toml"), **changes)
        store, plan = computed(settings.store, campaign, 10, fake_engine.simulate)
        write_state(store, plan.campaign_id, "completed")
        found[kind] = plan.campaign_id

    async def run(_, job, *arguments, **__):
        return await run_in_threadpool(compute, pickle.dumps((job, arguments, 64.0)), None)

    monkeypatch.setattr(service.pool, "run", run)
    client.portal.call(service.watcher.list_all)  # the page offers what the server has seen
    return found


def offered(text):
    """Return the campaigns that a page offers to pool, and the text after them."""
    offer, _, rest = text.partition("Of the same name, but not pooled")
    return [word.split('"')[0] for word in offer.split('name="others" value="')[1:]], rest


def test_page_offers_what_can_be_pooled(client, browse, ids):
    """Those with another seed; of the others of the same name it says why not, and offers a seed that none has."""
    browse("engineer")
    text = client.get(f"/campaigns/{ids['first']}/pool").text
    assert Page(text).faults == []
    possible, refused = offered(text)
    assert possible == [ids["second"]]
    assert ids["same"] in refused
    assert "seed = 7" in refused
    assert ids["other"] in refused
    assert "variables.J1.std" in refused
    assert f"/campaigns/new?from={ids['first']}&amp;seed=10" in text
    text = client.get(f"/campaigns/{ids['spread']}/pool").text
    assert "sampler = &#34;sobol&#34;" in text
    assert "another seed" not in text.partition("<h2")[2]


def test_report_is_that_of_all_samples(client, browse, ids):
    """Written by the form, shown in a frame, listed by page and call, and not for whoever came by a shared link."""
    headers = browse("engineer")
    home = f"/campaigns/{ids['first']}/pool"
    answer = client.post(home, data={"others": ids["second"]}, headers=headers)
    assert (answer.status_code, answer.headers["location"]) == (303, f"{home}?shown={ids['second']}")
    frame = f"/api/v1/campaigns/{ids['first']}/reports/pooled/{ids['second']}"
    text = client.get(answer.headers["location"]).text
    assert f'<iframe class="report" sandbox="allow-popups" src="{frame}/report.html"' in text
    assert json.loads(client.get(f"{frame}/capability.json").content)["requested"] == 50
    assert "1 pooled" in client.get(f"/campaigns/{ids['first']}/report").text


def test_calls(client, service, as_user, ids):
    """Engineers write, viewers read; what cannot be pooled is refused with the reason."""
    home = f"/api/v1/campaigns/{ids['first']}"
    wanted = {"others": [ids["second"]]}
    assert client.post(f"{home}/pools", json=wanted, headers=as_user("viewer")).status_code == 403
    made = client.post(f"{home}/pools", json=wanted, headers=as_user("engineer")).json()
    assert made["pool"] == ids["second"]
    assert "report.html" in made["files"]
    file = f"{home}/reports/pooled/{made['pool']}/report.html"
    assert client.get(file, headers=as_user("viewer")).status_code == 200
    assert client.get(f"{home}/reports", headers=as_user("viewer")).json()["pools"] == {made["pool"]: made["files"]}
    _, secret = service.tokens.share(ids["first"], "engineer", "", 60.0)
    shared = {"Authorization": f"Bearer {secret}"}
    assert client.get(file, headers=shared).status_code == 403
    assert client.get(f"{home}/reports", headers=shared).json()["pools"] == {}
    for others, words in (([ids["same"]], "seed = 7"), ([ids["other"]], "variables.J1.std"), ([], "one campaign")):
        answer = client.post(f"{home}/pools", json={"others": others}, headers=as_user("engineer"))
        assert (answer.status_code, words in answer.json()["detail"]) == (422, True), answer.text
    answer = client.post(f"{home}/pools", json={"others": ["none"]}, headers=as_user("engineer"))
    assert answer.status_code == 404
