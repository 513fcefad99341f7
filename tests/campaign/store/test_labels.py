"""What labels can be."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaign.errors import SpecError
from campaign.store.labels import LONGEST_NOTE, LONGEST_OWNER, LONGEST_TAG, LabelChange, Labels, is_owner
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
