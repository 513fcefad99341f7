"""Mechanisms saved in a store: each change is a version, and none is lost."""

import pytest

from campaign.errors import SpecError, StoreError
from campaign.store.mechanism_library import StaleMechanism, read_mechanism, save_mechanism, saved_mechanisms


def test_versions(store, plan):
    for text in ("a", "b"):
        save_mechanism(store, "latch", text, "eva")
    save_mechanism(store, "lever", "c", "ada", version=0)
    assert saved_mechanisms(store) == {"latch": 2, "lever": 1}
    newest = read_mechanism(store, "latch")
    assert (newest.text, newest.by, newest.version) == ("b", "eva", 2)
    assert read_mechanism(store, "latch", 1).text == "a"
    assert store.campaigns() == [plan.campaign_id]


def test_later_version_is_not_replaced(store):
    save_mechanism(store, "latch", "a", "eva", version=0)
    with pytest.raises(StaleMechanism, match=r"version 1\b"):
        save_mechanism(store, "latch", "b", "ada", version=0)
    assert read_mechanism(store, "latch").text == "a"


def test_no_such_mechanism(store):
    assert read_mechanism(store, "latch") is None
    assert read_mechanism(store, "../latch") is None
    save_mechanism(store, "latch", "a", "eva")
    assert read_mechanism(store, "latch", 2) is None


@pytest.mark.parametrize("name", ["", "../x", "a/b", "-x", "a b", "x" * 65, "a.toml"])
def test_odd_name_is_refused(store, name):
    with pytest.raises(SpecError, match="not allowed"):
        save_mechanism(store, name, "a", "eva")


def test_long_text_is_refused(store):
    with pytest.raises(SpecError, match="more than 1048576 bytes"):
        save_mechanism(store, "latch", "ä" * 600_000, "eva")


def test_damaged_document(store):
    store.write_json("mechanisms", "latch.000001.json", {"text": 1})
    with pytest.raises(StoreError, match="is not what clearcap wrote"):
        read_mechanism(store, "latch")
