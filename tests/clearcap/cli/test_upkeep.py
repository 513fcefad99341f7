"""``clearcap label``, ``compact`` and ``delete``."""

import io
import json
from contextlib import nullcontext

import pytest

from campaign.coordinator import submit as submission
from campaign.coordinator.lease import hold_lease
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store, part_name
from campaign.store.labels import read_labels
from tests.campaign.commands import clearcap_here
from tests.campaign.store.test_store import fill


@pytest.fixture
def say(capsys, monkeypatch, store):
    """Return a function that runs the command on the store as a user of some name."""

    def run(user, *words):
        monkeypatch.setattr(submission.getpass, "getuser", lambda: user)
        return clearcap_here(capsys, monkeypatch, *words, "--store", store.url)

    return run


def test_labels_are_changed_and_shown(store, plan, say):
    """Each option changes one thing; a version that is old is refused with exit status 1."""
    name = plan.campaign_id
    assert say("zoe", "label", name) == (0, f"{name}: owner -, no tags (version 0)\n", "")
    words = ("--owner", "alice", "--tag", "b", "--tag", "a", "--note", "a note", "--archive")
    code, printed, _ = say("zoe", "label", name[:-2], *words)
    assert (code, printed.splitlines()) == (0, [f"{name}: owner alice, tags a, b, archived (version 1)", "  a note"])
    assert read_labels(store, name).changed_by == "zoe"
    code, printed, _ = say("zoe", "label", name, "--untag", "a", "--restore", "--version", "1", "--json")
    changed = {"owner": "alice", "tags": ["b"], "note": "a note", "archived": False, "version": 2}
    assert (code, json.loads(printed)) == (0, {"campaign": name, "store": store.url, **changed})
    code, _, said = say("bob", "label", name, "--note", "", "--version", "1")
    assert code == 1
    assert "changed by zoe and are now version 2" in said
    code, _, said = say("bob", "label", name, "--tag", "two words")
    assert code == 2
    assert "tag 'two words': not allowed" in said


def test_list_filters_and_hides(store, plan, campaign_file, say):
    """By owner and by all of several tags; archived ones only if they are asked for."""
    other = make_plan(load_campaign(str(campaign_file), seed=1), 10).campaign_id
    store.create_plan(make_plan(load_campaign(str(campaign_file), seed=1), 10))
    say("zoe", "label", plan.campaign_id, "--owner", "alice", "--tag", "a", "--tag", "b")
    say("zoe", "label", other, "--owner", "bob", "--tag", "a", "--archive")

    def listed(*words):
        return {entry["campaign"] for entry in json.loads(say("zoe", "list", "--json", *words)[1])}

    assert listed() == listed("--owner", "alice") == listed("--tag", "a", "--tag", "b") == {plan.campaign_id}
    assert listed("--archived") == listed("--archived", "--tag", "a") == {plan.campaign_id, other}
    assert listed("--owner", "bob") == listed("--owner", "nobody", "--archived") == set()
    entry = json.loads(say("zoe", "list", "--json")[1])[0]
    labels = {"owner": "alice", "tags": ["a", "b"], "note": "", "archived": False, "labels_version": 1}
    assert {key: entry[key] for key in labels} == labels
    _, printed, said = say("zoe", "list")
    assert "  alice  a, b  demo" in printed
    assert "1 archived campaign is left out; show all with --archived" in said
    _, printed, said = say("zoe", "list", "--owner", "nobody")
    assert (printed, "none of its 2 campaigns is listed with these options" in said) == ("", True)


def test_strange_labels_break_no_list(store, plan, say):
    """They count as none, and the list says what is wrong."""
    store.files.write(f"{plan.campaign_id}/labels-000001.json", b"{}")
    code, printed, said = say("zoe", "list")
    assert code == 0
    assert plan.campaign_id in printed
    assert "labels-000001.json is not what clearcap wrote" in said


@pytest.mark.slow
def test_the_first_who_submits_is_the_owner(tmp_path, campaign_file, say):
    """By default under the own name; whoever submits the same learns whose it is, and its tags are added."""
    campaign_file.write_text(campaign_file.read_text().replace("seed = 7", "seed = 6"))
    code, name, said = say("alice", "submit", str(campaign_file), "--queue-only", "--tag", "a")
    store = open_store(str(tmp_path / "runs"))
    labels = read_labels(store, name := name.strip())
    assert (code, labels.owner, labels.tags, labels.changed_by) == (0, "alice", ("a",), "alice")
    assert "its owner" not in said
    assert "its owner" not in say("alice", "submit", str(campaign_file), "--queue-only")[2]
    for words in ((), ("--owner", "bob"), ("--tag", "b", "--owner", "carol")):
        _, again, said = say("bob", "submit", str(campaign_file), "--queue-only", *words)
        assert again.strip() == name
        assert f"campaign {name} was submitted before: its owner is and stays alice" in said
    assert (read_labels(store, name).owner, read_labels(store, name).tags) == ("alice", ("a", "b"))
    campaign_file.write_text(campaign_file.read_text().replace("seed = 6", "seed = 8"))
    name = say("alice", "submit", str(campaign_file), "--queue-only", "--owner", "the press shop")[1].strip()
    assert read_labels(store, name).owner == "the press shop"
    campaign_file.write_text(campaign_file.read_text().replace("seed = 8", "seed = 9"))
    code, name, _ = say("\x1b[31m", "submit", str(campaign_file), "--queue-only")
    assert (code, read_labels(store, name.strip()).owner) == (0, "")


def test_a_campaign_without_an_owner_gets_one_that_is_named(store, plan, campaign_file, say):
    """One of an earlier version: whoever submits it again is not its owner, unless he says so."""
    say("bob", "submit", str(campaign_file), "--queue-only")
    assert read_labels(store, plan.campaign_id).version == 0
    say("bob", "submit", str(campaign_file), "--queue-only", "--owner", "bob")
    assert read_labels(store, plan.campaign_id).owner == "bob"


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


def test_compact(store, plan, capsys, monkeypatch):
    """Parts are merged, bad ones are named, and what was done is said."""
    fill(store, plan)
    store.files.write(part_name(plan, 2), b"damaged")
    code, output, messages = clearcap_here(capsys, monkeypatch, "compact", "--store", store.url, "--json")
    document = json.loads(output)
    assert code == 0
    assert document["written"] == ["rows-000000-000001.parquet"]
    assert (document["removed"], document["files"], document["bad_batches"]) == (2, 1, [2])
    assert "part-000002.parquet is truncated or damaged" in messages
    code, output, _ = clearcap_here(capsys, monkeypatch, "compact", plan.campaign_id, "--store", store.url)
    assert (code, output) == (0, f"{plan.campaign_id}: 0 files merged into 0; the campaign has 1 file of rows now\n")
