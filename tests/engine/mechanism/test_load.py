"""Files and shipped names: what loads, and what is said of what does not."""

import errno
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from engine.errors import MechanismError
from engine.mechanism import Mechanism, library_names, load, load_mechanism, load_mechanism_text, mechanism_from
from engine.mechanism.bodies import Body
from tests.each import each

MINIMAL = """
format = 1
name = "ball"
units = "SI"
[simulation]
step = 1e-3
horizon = 1
penetration = 1e-8
rest = { window = 0.1, drift = 1e-6 }
[bodies.ball]
mass = 1
inertia = [1, 1, 1]
"""


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "m.toml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def message(name_or_path: str | Path) -> str:
    with pytest.raises(MechanismError) as caught:
        load_mechanism(name_or_path)
    return str(caught.value)


def test_the_shipped_ones_load():
    assert library_names() == [
        "bouncing_ball",
        "c60",
        "c60_public",
        "chain",
        "clearance_pendulum",
        "door_latch",
        "double_pendulum",
        "four_bar",
        "incline",
        "lever",
        "planetary_gear",
        "push_button",
        "slider_crank",
        "sphere_roll",
        "spinning_top",
    ]
    for name in library_names():
        mechanism = load_mechanism(name)
        assert isinstance(mechanism, Mechanism)
        assert mechanism.name == name
        assert mechanism.title
        assert mechanism.description


def test_a_path_loads_as_text_and_as_path(tmp_path):
    path = write(tmp_path, MINIMAL)
    assert load_mechanism(path) == load_mechanism(str(path))
    assert load_mechanism(path).bodies["ball"].mass == 1.0


def test_a_text_loads_as_its_file_does(tmp_path):
    """As text and as bytes, with the mark that some editors write."""
    mechanism = load_mechanism(write(tmp_path, MINIMAL))
    assert load_mechanism_text(MINIMAL) == load_mechanism_text(b"\xef\xbb\xbf" + MINIMAL.encode()) == mechanism


@each(
    ("text", "said"),
    [
        ("", "a.toml: 6 faults\n  format: missing"),
        ("x = ", "a.toml: not TOML: "),
        (b"\xff", "a.toml: line 1: not UTF-8 text"),
        ("\ud800", "a.toml: line 1: not UTF-8 text"),
        (b"PAR1\x15\x00", "a.toml: is a Parquet file"),
        ("#" * 1_000_001, "a.toml: has 1000001 bytes; allowed: up to 1000000; shorten it"),
        ('mechanism = "c60"\nsamples = 3', "a.toml: is a campaign file, not a mechanism"),
        ("a = 1", "a.toml: not a mechanism"),
    ],
)
def test_a_text_that_is_no_mechanism(text, said):
    """The message has the name that it is given by."""
    with pytest.raises(MechanismError) as caught:
        load_mechanism_text(text, "a.toml")
    assert str(caught.value).startswith(said)


def test_an_unknown_name_lists_the_shipped_ones():
    text = message("c61")
    assert text.startswith(
        "c61: no such mechanism; shipped are bouncing_ball, c60, c60_public, chain, clearance_pendulum, "
    )
    assert "did you mean 'c60'?" in text


@pytest.mark.parametrize("name", ["no/such", "none.toml"])
def test_an_absent_file_is_said_to_be_absent(name):
    why = "cannot be read (no such file or directory); give a mechanism's TOML file"
    assert message(name) == f"{name}: {why}"


def test_a_folder_is_no_file(tmp_path):
    assert "cannot be read (is a folder, not a regular file)" in message(tmp_path)


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    """The system's refusal is passed on; it is simulated, for root may read everything."""

    def refuse(path, at_most):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(load, "read_regular_file", refuse)
    assert "permission denied" in message(write(tmp_path, MINIMAL))


def test_a_large_file_is_not_read(tmp_path):
    assert "1000001 bytes; allowed: up to 1000000" in message(write(tmp_path, b"#" * 1_000_001))


def test_text_must_be_utf8(tmp_path):
    assert "line 3: not UTF-8 text" in message(write(tmp_path, b"# one\n# two\n# caf\xe9\n"))


@pytest.mark.parametrize(
    ("text", "place"),
    [("format = 1\nname = \n", "line 2"), (MINIMAL + "[bodies.ball]\n", "line"), ("a = 1\na.b = 2\n", "line 2")],
)
def test_what_is_not_toml_is_said_with_its_line(tmp_path, text, place):
    path = write(tmp_path, text)
    said = message(path)
    assert said.startswith(f"{path}: not TOML: ")
    assert place in said


def test_deep_nesting_is_refused(tmp_path):
    assert "m.toml" in message(write(tmp_path, "x = " + "[" * 100_000))


def test_an_empty_file_says_what_is_missing(tmp_path):
    said = message(write(tmp_path, ""))
    for key in ("format", "name", "units", "simulation", "bodies"):
        assert f"  {key}: missing" in said


def test_the_first_line_names_the_file(tmp_path):
    path = write(tmp_path, MINIMAL.replace("mass = 1", "mass = -1"))
    assert message(path).split("\n")[0] == f"{path}: 1 fault"


@pytest.mark.processes
def test_a_description_loads_without_tables_and_cluster():
    code = "import sys, engine.mechanism; print([m for m in ('dask', 'pandas', 'pyarrow') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(
    ("key", "text"),
    [
        (
            "mass = 1e101",
            "bodies.a.mass = 1e+101 g: implausible for a physical quantity; allowed: sizes up to 1e+100",
        ),
        ("mass = 5e-324", "bodies.a.mass = 5e-324 g: too small for a physical quantity; allowed: from 1e-100"),
        ("mass = 1.0\norigin = [0, 1e300, 0]", "bodies.a.origin = 1e+300 mm: implausible for a physical quantity"),
    ],
)
def test_a_number_of_absurd_size_is_refused(key, text):
    """Squares and products of it overflowed in the assembly and after it."""
    data = {
        "format": 1,
        "name": "absurd",
        "units": "mm-g-ms",
        "simulation": {"step": 0.01, "horizon": 1.0, "penetration": 1e-6, "rest": {"window": 0.1, "drift": 1e-6}},
        "bodies": {"a": {"inertia": [1.0, 1.0, 1.0], **tomllib.loads(key)}},
    }
    with pytest.raises(MechanismError, match=re.escape(text)):
        mechanism_from(data, "absurd.toml")


def test_an_inertia_whose_inverse_overflows_is_refused():
    """One moment of 5e-324 made a jam's rows overflow."""
    data = {"fixed": False, "mass": 1.0, "inertia": [0.004, 0.004, 5e-324]}
    with pytest.raises(ValueError, match="not positive definite"):
        Body.model_validate(data)


FIRST_IN_THREADS = """
import sys, threading
from concurrent.futures import ThreadPoolExecutor
from pydantic import ValidationError
from engine.mechanism import Mechanism
from engine.mechanism.base import TableModel

def below(kind):
    return [each for child in kind.__subclasses__() for each in (child, *below(child))]

def use(_):
    for kind in kinds:
        together.wait(60)
        try:
            kind.model_validate({})
        except ValidationError:
            pass

sys.setswitchinterval(1e-6)
kinds, together = below(TableModel), threading.Barrier(16)
assert Mechanism in kinds
with ThreadPoolExecutor(16) as pool:
    list(pool.map(use, range(16)))
"""


@pytest.mark.processes
def test_threads_may_be_the_first_to_use_a_table():
    """The model of a table is built when it is first used; with pydantic 2.13 another thread found it half built."""
    done = subprocess.run([sys.executable, "-c", FIRST_IN_THREADS], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
