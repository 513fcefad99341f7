"""A campaign as text, with a closed set of files: the same as of a folder, and nothing else is ever opened."""

import builtins
import io
import json
import os
import pickle
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import pytest
import tomli_w

import engine
from campaign.errors import SpecError
from campaign.plan import make_plan
from campaign.spec.load import load_campaign, load_campaign_text
from campaign.spec.named_files import LARGEST_TOTAL, GivenFiles, campaign_names
from tests.campaign.conftest import SPEC
from tests.counts import some
from tests.each import each
from tests.house import ROOT

LIBRARY = Path(engine.__file__).parent / "mechanism" / "library"
MEASURED = b"gap,other\n0.05,x\n0.07,y\n0.06,z\n"
MINE = (
    SPEC.replace('"c60"', '"parts/mine.toml"')
    + """
[variables.J2]
distribution = "empirical"
file = "gaps.csv"
column = "gap"
"""
)
FILES = {"parts/mine.toml": (LIBRARY / "c60.toml").read_bytes(), "gaps.csv": MEASURED}

# names of files that a text may have, none of which is given with it
OUTSIDE = [
    "/etc/passwd",
    "../mine.toml",
    "parts/../../mine.toml",
    "./../gaps.csv",
    "link.toml",
    "link.csv",
    "/dev/zero",
    "/dev/stdin.csv",
    "/proc/self/environ",
    "/proc/self/fd/0.csv",
    "~/.ssh/id_rsa",
    "~root/x.toml",
    "$HOME/x.csv",
    "http://127.0.0.1:9/x.toml",
    "https://example.org/x.csv",
    "file:///etc/passwd",
    "s3://bucket/x.parquet",
    "C:\\Windows\\win.ini",
    "C:/x.toml",
    "\\\\server\\share\\x.toml",
    "\\\\.\\pipe\\x.csv",
    "CON",
    "nul.toml",
    "COM1.csv",
    "a\0b.toml",
    "/etc/passwd\0.csv",
    "gaps.csv/",
    "gaps.csv\0",
    "GAPS.CSV",
    "parts",
    "passwd",
    "long" * 2000 + ".toml",
    "library/c60",
    "c60.toml",
    "..",
    ".",
    "/",
]
PLACES = ("mechanism", "variables.J1.file", "table.file")


def naming(name, place):
    """Return a sound campaign that names a file at one place."""
    tables = tomllib.loads(SPEC)
    if place == "mechanism":
        tables["mechanism"] = name
    elif place == "table.file":
        tables |= {"sampler": "list", "table": {"file": name}}
    else:
        tables["variables"]["J1"] = {"distribution": "empirical", "file": name, "column": "x"}
    return tomli_w.dumps(tables)


def refusal(text, files=None):
    """Return why a campaign is refused."""
    with pytest.raises(SpecError) as refused:
        load_campaign_text(text, files or {})
    return str(refused.value)


def test_text_and_folder_are_one_campaign(tmp_path):
    """The same plan: its id, its spec and its mechanism do not tell where the files were."""
    (tmp_path / "mine.toml").write_text(MINE)
    (tmp_path / "parts").mkdir()
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    of_folder, of_text = load_campaign(str(tmp_path / "mine.toml")), load_campaign_text(MINE, FILES)
    assert make_plan(of_text, 10).to_json() == make_plan(of_folder, 10).to_json()
    assert of_text.spec.variables["J2"].values == (0.05, 0.07, 0.06)
    assert load_campaign_text(MINE.encode(), FILES, samples=9, seed=3).spec.samples == 9
    again = pickle.loads(pickle.dumps(of_text))
    assert make_plan(again, 10).to_json() == make_plan(of_folder, 10).to_json()


@pytest.mark.parametrize("name", campaign_names())
def test_shipped_campaigns_load_from_their_text(name):
    """They name shipped mechanisms only."""
    text = (ROOT / "campaign" / "library" / f"{name}.toml").read_bytes()
    assert load_campaign_text(text) == load_campaign(name)


def test_sample_table_and_leading_dot():
    """The samples of a list, and names that begin with ``./``."""
    text = naming("./rows.csv", "table.file").replace("samples = 25", "samples = 2")
    campaign = load_campaign_text(text, {"rows.csv": b"J1,preload\n0.05,0.9\n0.06,0.95\n"})
    assert campaign.spec.table.columns["J1"] == (0.05, 0.06)


def forbid_opening(monkeypatch):
    """Make every way to open or look at a file fail in this thread, but for shipped files."""
    opened, here = [], threading.get_ident()  # a server of other tests may look at its store meanwhile

    def watched(function):
        def call(path, *args, **options):
            is_open = isinstance(path, int)  # a descriptor: it was opened by name before
            if threading.get_ident() == here and not is_open and not str(path).startswith(str(LIBRARY)):
                opened.append(path)
                raise AssertionError(f"touched {path!r}")
            return function(path, *args, **options)

        return call

    for module, name in ((builtins, "open"), (io, "open"), (os, "open"), (os, "stat"), (os, "lstat"), (os, "readlink")):
        monkeypatch.setattr(module, name, watched(getattr(module, name)))
    return opened


@pytest.fixture
def tempting(tmp_path):
    """Return a folder with files of the names that a text may have."""
    for target, link in (("/etc/passwd", "link.toml"), ("/etc/passwd", "link.csv"), ("/etc/passwd", "passwd")):
        (tmp_path / link).symlink_to(target)
    (tmp_path / "mine.toml").write_text("secret = 1")
    (tmp_path / "here").mkdir()
    return tmp_path


@each("place", PLACES)
@each("name", some(OUTSIDE))
def test_files_outside_are_refused_untouched(name, place, tempting, monkeypatch):
    """The message names the key; nothing was opened, nor looked for, even where a file of that name is there."""
    monkeypatch.chdir(tempting / "here" if name.startswith("..") else tempting)
    text = naming(name, place)
    refusal(text, FILES)  # imports what it needs
    with monkeypatch.context() as patch:
        opened = forbid_opening(patch)
        said = refusal(text, FILES)
    assert opened == []
    heading, *lines = said.splitlines()
    assert heading == "campaign:"
    line = next(line.strip() for line in lines[::-1] if line.strip().startswith(f"{place} = "))
    assert "no such file is given with the campaign" in line or "ends neither in .csv nor in .parquet" in line
    assert "root:" not in said
    assert "secret" not in said
    assert str(tempting) not in said


WATCHED = """\
import json, sys
import pyarrow.csv, pyarrow.parquet
from campaign.errors import SpecError
from campaign.spec.load import load_campaign_text

texts, files = json.load(sys.stdin)
files = {name: content.encode() for name, content in files.items()}
seen = []
def hook(event, args):
    if event in ("open", "os.open", "os.listdir", "os.scandir", "subprocess.Popen", "socket.connect", "os.exec"):
        seen.append([event, repr(args[0])])
load_campaign_text(texts[0], files)  # imports what it needs
sys.addaudithook(hook)
for text in texts:
    try:
        load_campaign_text(text, files)
    except SpecError:
        pass
json.dump(seen, sys.stdout)
"""


@pytest.mark.slow
@pytest.mark.processes
def test_the_interpreter_sees_no_file_opened():
    """What an audit hook hears of: shipped mechanisms, and the memory in use when a data file is decoded."""
    texts = [MINE, *(naming(name, place) for name in OUTSIDE for place in PLACES)]
    sent = json.dumps([texts, {name: content.decode() for name, content in FILES.items()}])
    words = [sys.executable, "-c", WATCHED]
    done = subprocess.run(words, input=sent, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]
    # a descriptor was opened by name before
    seen = {(kind, name) for kind, name in json.loads(done.stdout) if not name.isdigit()}
    shipped = {event for event in seen if event[1].strip("'").startswith(str(LIBRARY))}
    assert ("open", repr(str(LIBRARY / "c60.toml"))) in shipped  # the hook hears
    assert seen - shipped <= {("open", "'/proc/self/statm'")}


def test_what_is_there_is_said():
    """Names of given files and of shipped mechanisms, and the one that may be meant."""
    said = refusal(naming("parts/mine.tml", "mechanism"), FILES)
    assert "allowed: those that are: parts/mine.toml, gaps.csv, and shipped mechanisms: bouncing_ball, c60, " in said
    assert "did you mean 'parts/mine.toml'?" in said
    said = refusal(naming("gap.csv", "variables.J1.file"), FILES)
    assert "parts/mine.toml, gaps.csv; give it too, or name another; did you mean 'gaps.csv'?" in said
    assert "those that are; no file was given; give it too" in refusal(naming("gap.csv", "table.file"))


def test_faults_of_given_files():
    """A mechanism with faults, and data without the column, are quoted: whoever gave them knows them."""
    broken = FILES["parts/mine.toml"].replace(b'name = "c60"', b"nam = 1", 1)
    assert "parts/mine.toml: 2 faults" in refusal(MINE, FILES | {"parts/mine.toml": broken})
    assert "no column gap; columns: gip" in refusal(MINE, FILES | {"gaps.csv": b"gip\n1\n"})
    assert "is a JSON document" in refusal(MINE, FILES | {"parts/mine.toml": b'{"a": 1}'})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("samples = ", "campaign: not TOML: "),
        (b"\xff", "campaign: line 1: not UTF-8 text"),
        ("x" * 2_000_000, "campaign: has 2000000 bytes; allowed: up to 1000000"),
        ("x = " + "[" * 1000, "campaign: line 1: more than 16 lists"),
        (b"PAR1\x15\x00", "campaign: is a Parquet file"),
        ('units = "SI"\nformat = 1', "campaign: is a mechanism file, not a campaign"),
        ("", "campaign:\n  format: missing; add it"),
    ],
)
def test_text_that_is_no_campaign(text, said):
    """One message, as of a file."""
    assert refusal(text).startswith(said)


@each(
    "name",
    ["/a.toml", "../a.toml", "a/../b.csv", "./a", "a//b", "a/", "a\\b", "C:a", "a\0b", "a\nb", "", ".", "x" * 201],
)
def test_names_of_given_files(name):
    """Only those that a file in the campaign's folder can have."""
    with pytest.raises(SpecError, match="name of a file given with a campaign"):
        GivenFiles({name: b""})


def test_names_that_files_have():
    """Dots, spaces and letters of any language."""
    names = ("a.toml", ".hidden.csv", "a..b/c d.csv", "größe.csv")
    assert [GivenFiles({name: b"1"}).content(name, 1) for name in names] == [b"1"] * 4


def test_too_much_is_refused(monkeypatch):
    """Too many files, too much in all, one too large."""
    with pytest.raises(SpecError, match=r"\b101 files"):
        GivenFiles({f"{i}.csv": b"" for i in range(101)})
    monkeypatch.setattr("campaign.spec.named_files.LARGEST_TOTAL", 10)
    with pytest.raises(SpecError, match=r"\b12 bytes"):
        GivenFiles({"a.csv": b"123456", "b.csv": b"123456"})
    monkeypatch.undo()
    assert LARGEST_TOTAL == 200_000_000
    monkeypatch.setattr("campaign.spec.named_files.LARGEST_FILE", 5)
    assert f"has {len(MEASURED)} bytes; allowed: up to 5" in refusal(MINE, FILES)
