"""Labels: whoever changes them, nothing is lost without a word; nothing that is computed knows of them."""

import json
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaign.errors import SpecError, StoreError
from campaign.store import labels as subject
from campaign.store import open_store
from campaign.store.labels import (
    KEPT,
    LONGEST_NOTE,
    LONGEST_OWNER,
    LONGEST_TAG,
    MOST_TAGS,
    LabelChange,
    Labels,
    StaleLabels,
    change_labels,
    claim,
    is_owner,
    read_labels,
)
from campaign.store.layout import labels_name
from tests.each import each


@each(
    ("change", "fault"),
    [
        ({"owner": "a" * (LONGEST_OWNER + 1)}, f"owner: has {LONGEST_OWNER + 1} characters; allowed: up to"),
        ({"owner": "a\nb"}, r"owner: has the hidden character U\+000A"),
        ({"owner": "a\u202eb"}, r"owner: has the hidden character U\+202E"),
        ({"owner": 7}, "owner: 7 is not text"),
        ({"note": "a" * (LONGEST_NOTE + 1)}, "note: has"),
        ({"note": "\x1b[31m"}, r"note: has the hidden character U\+001B"),
        ({"add": ("two words",)}, "tag 'two words': not allowed; a tag has letters"),
        ({"add": ("",)}, "tag '': not allowed"),
        ({"add": ("-a",)}, "begins with a letter"),
        ({"add": ("a" * (LONGEST_TAG + 1),)}, "tag: has 41 characters"),
        ({"add": ("<b>",)}, "not allowed"),
    ],
)
def test_what_no_label_can_be(change, fault):
    """Too long, hidden, or not what a tag is made of."""
    with pytest.raises(SpecError, match=fault):
        LabelChange(**change)


@given(st.text(max_size=60))
def test_an_owner_is_whatever_can_be_seen(text):
    """A name is an owner's, or refused; never something in between."""
    if is_owner(text):
        assert LabelChange(owner=LabelChange(owner=text).owner).owner == LabelChange(owner=text).owner != ""


def test_filters():
    """All tags, and the owner, must be there; nothing asked is true of all."""
    labels = Labels("alice", ("a", "b"))
    asked = [(None, ()), ("alice", ("a",)), (None, ("a", "b")), ("bob", ()), (None, ("a", "c")), ("", ())]
    assert [labels.has(*filters) for filters in asked] == [True, True, True, False, False, False]


def test_a_document_is_read_back():
    """Whatever is written; the version is that of the file's name."""
    labels = Labels("alice", ("a",), "x", True, 3, "bob", 5.0)
    assert Labels.from_document(labels.document(), 3) == labels


def test_labels_are_kept_beside_the_plan(either_store, plan):
    """What is changed is read back, what is not named stays, and the plan has no part in it."""
    name, before = plan.campaign_id, either_store.files.read(f"{plan.campaign_id}/plan.json")
    assert read_labels(either_store, name) == Labels()
    labels = change_labels(either_store, name, LabelChange("Zoë", ("b", "a", "b")), by="zoe")
    assert (labels.owner, labels.tags, labels.version) == ("Zoë", ("a", "b"), 1)
    assert read_labels(either_store, name) == labels
    labels = change_labels(either_store, name, LabelChange(remove=("a", "never"), note="x\ny", archived=True))
    assert labels.to_json() == {"owner": "Zoë", "tags": ["b"], "note": "x\ny", "archived": True, "version": 2}
    assert read_labels(open_store(either_store.url), name) == labels
    assert change_labels(either_store, name, LabelChange(add=("b",))) == labels  # nothing changes, nothing is written
    assert change_labels(either_store, name, LabelChange(owner="", archived=False)).owner == ""
    assert either_store.files.read(f"{name}/plan.json") == before
    assert either_store.plan(name) == plan


def test_a_stale_writer_is_refused(either_store, plan):
    """Who read version 1 and writes after version 2 learns who was first; nothing of the first is lost."""
    change_labels(either_store, plan.campaign_id, LabelChange("alice"), by="alice", version=0)
    change_labels(either_store, plan.campaign_id, LabelChange(note="mine"), by="alice", version=1)
    with pytest.raises(StaleLabels, match=r"\balice\b.*version 2"):
        change_labels(either_store, plan.campaign_id, LabelChange(note="no, mine"), version=1)
    assert read_labels(either_store, plan.campaign_id).note == "mine"


def test_a_writer_who_is_overtaken_begins_again(store, plan, monkeypatch):
    """Between reading and writing another one writes: both changes are there; with a version, the later is refused."""
    create, others = store.create_json, iter(["first", "second"])

    def overtaken(name, document, content):
        other = next(others, None)
        if other:
            monkeypatch.setattr(store, "create_json", create)
            change_labels(store, plan.campaign_id, LabelChange(add=(other,)))
            monkeypatch.setattr(store, "create_json", overtaken)
        return create(name, document, content)

    monkeypatch.setattr(store, "create_json", overtaken)
    assert change_labels(store, plan.campaign_id, LabelChange(add=("own",))).tags == ("first", "own", "second")
    others = iter(["third"])
    version = read_labels(store, plan.campaign_id).version
    with pytest.raises(StaleLabels):
        change_labels(store, plan.campaign_id, LabelChange(note="x"), version=version)
    assert read_labels(store, plan.campaign_id).tags == ("first", "own", "second", "third")


ADDS = """
import sys
from campaign.store import open_store
from campaign.store.labels import LabelChange, change_labels
store = open_store(sys.argv[1])
print("ready", flush=True)
sys.stdin.readline()
for number in range(5):
    change_labels(store, sys.argv[2], LabelChange(add=(f"{sys.argv[3]}{number}",)))
"""


@pytest.mark.processes
def test_two_processes_lose_nothing(either_store, plan):
    """Both add tags at the same time: all are there."""
    command = [sys.executable, "-c", ADDS, either_store.url, plan.campaign_id]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    both = [subprocess.Popen([*command, who], **pipes) for who in "ab"]
    assert [process.stdout.readline() for process in both] == ["ready\n", "ready\n"]
    for process in both:
        process.stdin.write("\n")
        process.stdin.flush()
    for process in both:
        process.communicate()
        assert process.returncode == 0
    labels = read_labels(either_store, plan.campaign_id)
    assert labels.tags == tuple(sorted(f"{who}{number}" for who in "ab" for number in range(5)))
    assert labels.version == 10


def test_a_listing_that_lags_behind_costs_nothing(store, plan, monkeypatch):
    """A shared folder may not list what another machine wrote: the number that is taken is read by its name."""
    for tag in ("a", "b"):
        change_labels(store, plan.campaign_id, LabelChange(add=(tag,)))
    names = type(store.files).names

    def old(self, folder):
        return [name for name in names(self, folder) if name != labels_name(2)]

    monkeypatch.setattr(type(store.files), "names", old)
    assert change_labels(store, plan.campaign_id, LabelChange(add=("c",))).tags == ("a", "b", "c")


def test_old_versions_are_removed(store, plan, monkeypatch):
    """As many stay as it takes; who comes with a number that was free long ago changes nothing in silence."""
    for number in range(KEPT + 5):
        change_labels(store, plan.campaign_id, LabelChange(note=str(number)))
    names = [name for name in store.files.names(plan.campaign_id) if name.startswith("labels-")]
    assert names == [labels_name(version) for version in range(6, KEPT + 6)]
    real, looks = subject._newest, []

    def long_ago(*where):
        looks.append(where)
        return Labels(version=1) if len(looks) == 1 else real(*where)

    monkeypatch.setattr(subject, "_newest", long_ago)
    labels = change_labels(store, plan.campaign_id, LabelChange(add=("late",)))
    assert (labels.version, labels.tags, labels.note) == (KEPT + 6, ("late",), str(KEPT + 4))
    assert labels_name(2) not in store.files.names(plan.campaign_id)


def test_the_first_owner_stays(store, plan):
    """A second one adds tags only; where nobody is the owner, the second becomes it."""
    first = claim(store, plan.campaign_id, LabelChange("alice", ("a",)))
    assert (first.owner, first.tags) == ("alice", ("a",))
    second = claim(store, plan.campaign_id, LabelChange("bob", ("b",)))
    assert (second.owner, second.tags) == ("alice", ("a", "b"))
    change_labels(store, plan.campaign_id, LabelChange(owner=""))
    assert claim(store, plan.campaign_id, LabelChange("bob")).owner == "bob"


def test_too_many_tags(store, plan):
    """The limit is on what there would be, and nothing is written."""
    tags = tuple(f"t{number}" for number in range(MOST_TAGS))
    change_labels(store, plan.campaign_id, LabelChange(add=tags))
    with pytest.raises(SpecError, match=f"there would be {MOST_TAGS + 1}"):
        change_labels(store, plan.campaign_id, LabelChange(add=("more",)))
    assert change_labels(store, plan.campaign_id, LabelChange(add=("more",), remove=tags[:1])).version == 2


def test_the_largest_labels_can_be_read(store, plan):
    """Whatever the limits allow can be read back."""
    wide = "\U00020000"  # four bytes
    tags = tuple(f"{number:02d}{wide * (LONGEST_TAG - 2)}" for number in range(MOST_TAGS))
    change = LabelChange(wide * LONGEST_OWNER, tags, (), wide * LONGEST_NOTE)
    assert change_labels(store, plan.campaign_id, change, by=wide * LONGEST_OWNER).tags == tags
    assert read_labels(store, plan.campaign_id).note == wide * LONGEST_NOTE


def test_labels_of_no_campaign(store):
    """Nothing makes a folder for a campaign that is not there."""
    with pytest.raises(SpecError, match="no campaign demo-0"):
        change_labels(store, "demo-0", LabelChange("alice"))
    assert "demo-0" not in store.files.names("")


SOUND = {"format": 1, "owner": "a", "tags": [], "note": "", "archived": False, "version": 1, "by": "", "time": 1.0}


@pytest.mark.parametrize(
    "content",
    [
        *(b"garbage", b"[]", b"{}", b'{"format": 1}'),
        *(json.dumps({**SOUND, **odd}).encode() for odd in ({"format": 2}, {"owner": 1}, {"tags": ["a b"]})),
        *(json.dumps({**SOUND, **odd}).encode() for odd in ({"time": "x"}, {"tags": ["a"] * 21}, {"time": 10**400})),
        json.dumps({**SOUND, "more": "x" * 20_000}).encode(),
    ],
)
def test_strange_labels_are_an_error_that_names_the_file(store, plan, content):
    """And of this campaign only."""
    store.files.write(f"{plan.campaign_id}/{labels_name(1)}", content)
    with pytest.raises(StoreError, match=r"labels-000001\.json"):
        read_labels(store, plan.campaign_id)
