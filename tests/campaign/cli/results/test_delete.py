"""``clearcap delete``: a campaign is gone for good, but only if it is meant and idle."""

import io
import json
from contextlib import nullcontext

import pytest

from campaign.coordinator.lease import hold_lease
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from tests.campaign.commands import clearcap_here
from tests.campaign.store.test_store import fill


class Answer(io.StringIO):
    """What somebody types at a terminal."""

    def isatty(self):
        """Say that somebody is there."""
        return True


@pytest.fixture
def another(store, campaign_file):
    """Return the id of a second campaign of the store, which must stay."""
    other = make_plan(load_campaign(str(campaign_file), seed=1), 10)
    store.create_plan(other)
    return other.campaign_id


def test_delete(store, plan, another, tmp_path, capsys, monkeypatch):
    """With ``--yes`` its folder is gone, by the first letters of its id too; a link in it loses what is linked not."""
    fill(store, plan)
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "kept").write_text("kept")
    (tmp_path / "runs" / plan.campaign_id / "report").symlink_to(outside)
    words = ["delete", plan.campaign_id[:-2], "--store", store.url, "--yes", "--json"]
    code, output, messages = clearcap_here(capsys, monkeypatch, *words)
    assert (code, messages) == (0, "")
    assert json.loads(output) == {"campaign": plan.campaign_id, "store": store.url, "rows": 25}
    assert store.campaigns() == [another]
    assert not (tmp_path / "runs" / plan.campaign_id).exists()
    assert (outside / "kept").read_text() == "kept"


def test_broken_campaign(store, another, capsys, monkeypatch):
    """A campaign that cannot be read can be deleted."""
    store.files.write("broken-0123456789/plan.json", b"{}")
    code, _, messages = clearcap_here(capsys, monkeypatch, "delete", "broken", "--store", store.url, "--yes")
    assert code == 0, messages
    assert "broken-0123456789" not in store.campaigns()


@pytest.mark.parametrize(
    ("how", "code"), [("nobody is asked", 2), ("no", 1), ("running", 1), ("id not given", 2), ("id empty", 2)]
)
def test_nothing_is_deleted(store, plan, how, code, capsys, monkeypatch):
    """Without a yes, or while it is computed, or without its id, all stays."""
    fill(store, plan)
    words = ["delete", plan.campaign_id, "--store", store.url]
    if how == "no":
        monkeypatch.setattr("sys.stdin", Answer("n\n"))
    elif how == "running":
        words.append("--yes")
    elif how.startswith("id"):
        words = ["delete", *([""] if how == "id empty" else []), "--store", store.url, "--yes"]
    before = sorted(store.files.names(plan.campaign_id))
    with hold_lease(store, plan.campaign_id) if how == "running" else nullcontext():
        found, _, messages = clearcap_here(capsys, monkeypatch, *words)
    assert found == code, messages
    assert sorted(store.files.names(plan.campaign_id)) == before
    assert store.survey(plan).rows == 25
    if how == "nobody is asked":
        assert "25 rows and its report would be gone for good; add --yes" in messages
    if how == "running":
        assert f"end it first with: clearcap cancel {plan.campaign_id} --store {store.url}" in messages
