"""Tables become text, and the text the same tables."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from campaign.plan import dump_spec
from campaign.spec.campaign_file import campaign_text
from campaign.spec.load import load_campaign, load_campaign_text
from campaign.spec.named_files import campaign_names
from tests.counts import many
from tests.house import ROOT


@pytest.mark.parametrize("name", campaign_names())
def test_shipped_campaigns(name):
    """The tables of the file, in any order, and those of the checked campaign."""
    tables = tomllib.loads((ROOT / "campaign" / "library" / f"{name}.toml").read_text("utf-8"))
    text = campaign_text(tables)
    assert tomllib.loads(text) == tables
    assert campaign_text(dict(reversed(tables.items()))) == text
    loaded = load_campaign(name)
    assert load_campaign_text(campaign_text(dump_spec(loaded.spec))) == loaded


NAMES = st.text(st.characters(codec="utf-8"), max_size=5) | st.sampled_from(["name", "variables", "format"])
SCALARS = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.booleans() | NAMES
VALUES = st.recursive(SCALARS, lambda v: st.lists(v, max_size=3) | st.dictionaries(NAMES, v, max_size=3), max_leaves=9)


@settings(max_examples=many(200), deadline=None)
@given(st.dictionaries(NAMES, VALUES, max_size=5))
def test_any_tables(tables):
    """Sound or not: a form shows what it has."""
    assert tomllib.loads(campaign_text(tables)) == tables


def test_reading_order_and_what_is_not_given():
    """What a campaign is comes first; empty fields of a form are left out."""
    variables = {"J1": {"distribution": "normal", "mean": None, "std": 0.1}}
    tables = {"variables": variables, "seed": None, "samples": 3, "name": "a", "stray": 1, "format": 1}
    assert campaign_text(tables) == (
        'format = 1\nname = "a"\nsamples = 3\nstray = 1\n\n[variables.J1]\ndistribution = "normal"\nstd = 0.1\n'
    )
