"""Which campaign is meant: an id or its first letters, and what is said where that is none or several."""

import pytest

from campaign.errors import SpecError
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store


def test_which_campaign(store, plan, campaign_file):
    """The only campaign need not be named; several must be, and an unknown one is refused with the list."""
    assert store.find(None) == plan.campaign_id
    other = make_plan(load_campaign(str(campaign_file), seed=1))
    store.create_plan(other)
    assert store.find(other.campaign_id) == other.campaign_id
    for campaign_id in (None, "../etc", "demo", ""):
        with pytest.raises(SpecError, match=plan.campaign_id):
            store.find(campaign_id)


def test_first_letters(store, plan, campaign_file):
    """As many letters as tell it from the others; a whole id is itself, though another one begins with it."""
    other = make_plan(load_campaign(str(campaign_file), seed=1))
    store.create_plan(other)
    differ = next(n for n in range(5, 15) if plan.campaign_id[:n] != other.campaign_id[:n])
    assert store.find(plan.campaign_id[:differ]) == plan.campaign_id
    with pytest.raises(SpecError, match=r"demo- .*several"):
        store.find("demo-")
    longer = f"{plan.campaign_id}x"
    store.files.write(f"{longer}/plan.json", b"{}")
    assert store.find(plan.campaign_id) == plan.campaign_id
    assert store.find(longer) == longer


def test_no_store(store, plan, tmp_path):
    """A folder that is not there, a file, one campaign's folder, and an empty store: each is said, with what to do."""
    (tmp_path / "file").write_text("x")
    (tmp_path / "empty dir").mkdir()
    said = {
        "nowhere": "no such folder; name the folder of your results with --store, or make one: clearcap run CAMPAIGN",
        "file": "is a file, not a folder of campaigns",
        "file/below": "no such folder",
        "empty dir": "holds no campaign; make one: clearcap run CAMPAIGN --store '.*empty dir'",
        f"runs/{plan.campaign_id}": f"is the folder of one campaign, not a store; write {plan.campaign_id} --store ",
    }
    for name, message in said.items():
        for campaign_id in (None, plan.campaign_id):
            with pytest.raises(SpecError, match=message):
                open_store(str(tmp_path / name)).find(campaign_id)
