"""Where keys stand in a text: the one place where an editor marks what is wrong."""

import tomllib
from pathlib import Path

import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

import campaign
import engine
from engine.errors import Fault
from engine.faults.toml_positions import TextPosition, key_positions, position_of, with_positions
from tests.each import each

SHIPPED = [
    *sorted((Path(engine.__file__).parent / "mechanism" / "library").glob("*.toml")),
    *sorted((Path(campaign.__file__).parent / "library").glob("*.toml")),
]
TEXT = '''\
# a comment with = [ and "
format = 1
name = "a = b # [c]"
long = """
x = 1
[no]
"""
spot.x = 1.5
spot."y z" = 2

[variables.J1]
mean = 0.07
batch = {size = 9, std = 1e-3}  # inline

[variables."a.b"]
list = [1, 2.5,
  [3, {k = 4}],
]

[[phases]]
name = "one"
[[phases]]
  name = "two"
  [phases.until]
  response = 'FC'
[variables]
late = true
'''
PLACES = {
    "format": (2, 1),
    "name": (3, 1),
    "long": (4, 1),
    "spot": (8, 1),
    "spot x": (8, 6),
    "spot y.z": (9, 6),
    "variables": (26, 2),
    "variables J1": (11, 12),
    "variables J1 mean": (12, 1),
    "variables J1 batch": (13, 1),
    "variables J1 batch std": (13, 20),
    "variables a_b": (15, 12),
    "variables a_b list 1": (16, 12),
    "variables a_b list 2": (17, 3),
    "variables a_b list 2 1": (17, 7),
    "variables a_b list 2 1 k": (17, 8),
    "phases": (20, 3),
    "phases 0 name": (21, 1),
    "phases 1": (22, 3),
    "phases 1 name": (23, 3),
    "phases 1 until response": (25, 3),
    "variables late": (27, 1),
    # what is not there: the nearest table
    "variables J1 std": (11, 12),
    "phases 1 until side": (24, 11),
    "phases 7 name": (20, 3),
    "nothing at all": (1, 1),
    "": (1, 1),
}


def keys_of(place):
    """Return the keys of a place: words, of which two stand for what needs quotes."""
    return [{"y.z": "y z", "a_b": "a.b"}.get(word, word) for word in place.split()]


@each("place", PLACES)
def test_each_key_has_its_place(place):
    """Headers, dotted and quoted keys, inline tables, lists, lists of tables; none in strings and comments."""
    assert position_of(TEXT, keys_of(place)) == TextPosition(*PLACES[place])
    assert position_of(TEXT.replace("\n", "\r\n"), keys_of(place)) == TextPosition(*PLACES[place])


def paths(value, path=()):
    """Yield the path of every key, table and entry of a list."""
    below = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in below:
        yield (*path, str(key))
        yield from paths(inner, (*path, str(key)))


@each("path", SHIPPED)
def test_every_key_of_a_shipped_file_is_found(path):
    """All of them, and no other; the text there begins with the key."""
    text = path.read_text("utf-8")
    places, lines = key_positions(text), text.split("\n")
    assert set(places) == set(paths(tomllib.loads(text)))
    for keys, at in places.items():
        if not keys[-1].isdigit():
            assert lines[at.line - 1][at.column - 1 :].lstrip("\"'").startswith(keys[-1])


NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=6)
SCALARS = st.integers(-9, 9) | st.floats(allow_nan=False) | st.booleans() | NAMES | st.dates()
VALUES = st.recursive(SCALARS, lambda v: st.lists(v, max_size=3) | st.dictionaries(NAMES, v, max_size=3), max_leaves=8)


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(NAMES, VALUES, max_size=4))
def test_every_key_of_any_text_is_found(tables):
    """Whatever the keys and values hold."""
    text = tomli_w.dumps(tables)
    assert set(key_positions(text)) == set(paths(tomllib.loads(text)))


@settings(max_examples=200, deadline=None)
@given(st.text("[]{}=.,'\"# \n\\ab1", max_size=40))
def test_no_text_is_too_odd(text):
    """What is no TOML has an end, too."""
    key_positions(text)


def test_faults_get_lines():
    """Each fault that of its key, or of the nearest table; a mark before the first character is none."""
    faults = [Fault(("variables", "J1", "mean"), "x"), Fault(("variables", "J1", "std"), "x"), Fault((), "x")]
    placed = with_positions(faults, b"\xef\xbb\xbf" + TEXT.encode())
    assert [(fault.line, fault.column) for fault in placed] == [(12, 1), (11, 12), (1, 1)]
