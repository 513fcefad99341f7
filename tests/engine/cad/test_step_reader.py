"""Files that are read in a process of their own: what is wrong with one is said in one line, and no process stays."""

import hashlib
import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import engine.cad.step_reader
from engine import CadError
from engine.cad import ReadingLimits, read_step
from engine.cad.archive import cached, keep_answer, packed
from engine.platform.child import ChildRaised, Limits, limited, within_own
from tests.engine.cad.assemblies import differences, full_assembly
from tests.until import until

pytestmark = pytest.mark.processes

LATCH = Path(__file__).parents[3] / "docs/examples/latch.step"


def refusal(path, **limits):
    """Return what is said about a file that cannot be read."""
    others = children()
    with pytest.raises(CadError) as error:
        read_step(path, limits=ReadingLimits(**limits))
    text = str(error.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert set(children()) <= set(others)
    return text.removeprefix(f"{path}: ")


def children():
    """Return the processes that this one has started and that have not ended."""
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()


def no_process(*_, **__):
    raise AssertionError("a process was started")


def test_a_file_is_read_once(own_cache, monkeypatch):
    """The second time comes from the cache, with the same bits, and from no other file or recognition."""
    first = read_step(LATCH)
    [kept] = own_cache.iterdir()
    monkeypatch.setattr("engine.cad.step_reader.Child", no_process)
    assert differences(read_step(LATCH), first) == []
    with pytest.raises(AssertionError, match="was started"):
        read_step(LATCH, recognition=1e-3)
    kept.write_bytes(kept.read_bytes()[:-100])
    with pytest.raises(AssertionError, match="was started"):
        read_step(LATCH)


def test_a_full_cache(own_cache, monkeypatch):
    """What was used longest ago goes first."""
    content = packed(full_assembly(np.random.default_rng(1)))
    monkeypatch.setattr("engine.cad.archive.MOST_BYTES", 2 * len(content))
    for age, name in enumerate("ab"):
        keep_answer(name * 64, repr(1e-4), content)
        [file] = own_cache.glob(f"{name}*")
        os.utime(file, times=(1e9 + age, 1e9 + age))
    assert cached("a" * 64, 1e-4) is not None  # so b is the one
    keep_answer("c" * 64, repr(1e-4), content)
    assert sorted(file.name[0] for file in own_cache.iterdir()) == ["a", "c"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty; give a STEP file"),
        (b"PK\x03\x04" + bytes(2000), "is a workbook or another ZIP archive; name a STEP file"),
        (b"solid cube\nfacet normal 0 0 1\n", "is not a STEP file: it lacks the first line ISO-10303-21;"),
        (LATCH.read_bytes()[:50_000], "was cut off: it does not end with END-ISO-10303-21;"),
    ],
)
def test_what_is_no_whole_step_is_refused_unread(tmp_path, monkeypatch, content, said):
    """No process is started for it."""
    monkeypatch.setattr("engine.cad.step_reader.Child", no_process)
    path = tmp_path / "file.step"
    path.write_bytes(content)
    assert said in refusal(path)


def test_files_that_are_none(tmp_path):
    """A folder, nothing at all, a device without end, more bytes than allowed."""
    assert "cannot be read (is a folder, not a regular file)" in refusal(tmp_path)
    assert "cannot be read (no such file or directory)" in refusal(tmp_path / "none.step")
    assert "is a device" in refusal(Path("/dev/zero"))
    large = tmp_path / "large.step"
    with large.open("wb") as file:
        file.truncate(200 * 10**6)
    assert "has 200000000 bytes; allowed: up to 104857600" in refusal(large)
    assert "with only the parts of the mechanism" in refusal(large)


def step(data):
    """Return a STEP file with these entities."""
    return (
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n" + data + "\nENDSEC;\nEND-ISO-10303-21;\n"
    )


RECURSIVE = """#1=PRODUCT_DEFINITION_SHAPE('','',#2);
#2=NEXT_ASSEMBLY_USAGE_OCCURRENCE('1','','',#3,#3,$);
#3=PRODUCT_DEFINITION('design','',#4,#5);
#4=PRODUCT_DEFINITION_FORMATION('','',#6);
#5=PRODUCT_DEFINITION_CONTEXT('part definition',#7,'design');
#6=PRODUCT('loop','loop','',(#8));
#7=APPLICATION_CONTEXT('automotive design');
#8=PRODUCT_CONTEXT('',#7,'mechanical');
#9=SHAPE_DEFINITION_REPRESENTATION(#10,#11);
#10=PRODUCT_DEFINITION_SHAPE('','',#3);
#11=SHAPE_REPRESENTATION('',(#12),#13);
#12=AXIS2_PLACEMENT_3D('',#14,$,$);
#13=(GEOMETRIC_REPRESENTATION_CONTEXT(3)REPRESENTATION_CONTEXT('',''));
#14=CARTESIAN_POINT('',(0.,0.,0.));"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "said"),
    [
        ("", "no shapes|no STEP|failed"),
        ("#1=CARTESIAN_POINT('',(0.,0.,0.));", "no shapes|failed"),
        (RECURSIVE, "no shapes|inside each other|crashed|failed"),
        ("#1=((((((((", "no STEP file that can be read|no shapes|failed"),
    ],
)
def test_steps_without_a_shape(tmp_path, data, said):
    """Files that begin and end as STEP does, and hold nothing, or themselves."""
    path = tmp_path / "file.step"
    path.write_text(step(data))
    assert any(each in refusal(path) for each in said.split("|"))


@pytest.mark.parametrize(
    ("program", "limits", "said"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", {}, "OCCT crashed while it read it (SIGSEGV)"),
        ("while True: pass", {"seconds": 2}, "OCCT needs more than 2 s to read it"),
        ("__version__ = '7.8'", {}, "is not the one that is needed (ModuleNotFoundError: No module named 'OCP."),
        (
            "raise SystemError('geometry')",
            {},
            "its shapes is broken, and OCCT failed to read it (SystemError: geometry); repair",
        ),
        ("x = bytearray(2**40)", {}, "takes more than 4 GiB of memory"),
    ],
)
def test_a_reader_that_fails(tmp_path, monkeypatch, program, limits, said):
    """OCCT can crash, take for ever, or take all memory: in place of it here is a program that does."""
    package = tmp_path / "OCP"
    package.mkdir()
    (package / "__init__.py").write_text(program)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert said in refusal(LATCH, **limits)


def test_a_crash_over_tolerances(monkeypatch):
    """The file is read again without them, if it has any; another failure is not tried twice."""
    content, asked = packed(full_assembly(np.random.default_rng(1))), []

    def crash(path, _content, question, _limits, error=engine.cad.step_reader.OcctFailed):
        asked.append(question["assembly"].get("tolerances", True))
        if asked[-1]:
            raise error(f"{path}: OCCT crashed")
        return content

    reader, kept = engine.cad.step_reader, []
    monkeypatch.setattr(reader, "cached", lambda *_: None)
    monkeypatch.setattr(reader, "keep_answer", lambda *answer: kept.append(answer))
    monkeypatch.setattr(reader, "ask_occt", crash)
    assert len(read_step(LATCH).parts) == 1
    assert (asked, len(kept)) == ([True, False], 1)
    monkeypatch.setattr(reader, "ask_occt", partial(crash, error=CadError))
    with pytest.raises(CadError):
        read_step(LATCH)
    monkeypatch.setattr(reader, "ask_occt", crash)
    monkeypatch.setattr(reader, "_TOLERANCES", (b"NOT IN THE FILE",))
    with pytest.raises(CadError):
        read_step(LATCH)
    assert asked == [True, False, True, True]


def test_a_reader_gets_what_is_left_to_a_job(tmp_path, monkeypatch):
    """Read by a job that has limits itself, a file is under these: no child of it has more."""
    package = tmp_path / "OCP"
    package.mkdir()
    (package / "__init__.py").write_text("x = bytearray(2**40)")
    monkeypatch.syspath_prepend(str(tmp_path))
    with limited(Limits(memory=3 * 2**30, processor_s=1000.0)):
        text = refusal(LATCH)
        own, less = within_own(Limits(2.0**40, 5000.0)), within_own(Limits(2.0**20, 5.0))
    assert "takes more than 3 GiB of memory" in text
    assert (own.memory, less) == (3 * 2**30, Limits(2.0**20, 5.0))
    assert 900.0 < own.processor_s <= 1001.0  # limits are whole seconds
    assert within_own(Limits()) == Limits()


@pytest.mark.parametrize(
    ("module", "said"),
    [
        ("names_and_materials", "export it again without materials, and give each body its density"),
        ("face_pieces", "repair the parts in the CAD system, and export them again, as AP242 or AP214"),
    ],
)
def test_what_nobody_foresaw_in_a_file(module, said):
    """The message says what the reader was at, and what to do about it: the name of an error alone teaches nothing."""
    trace = f'Traceback:\n  File "/x/engine/cad/occt/{module}.py", line 1, in f\n    a.b\nAttributeError\n'
    report = {"kinds": ["AttributeError"], "message": "", "trace": trace, "faults": None}
    text, failed = engine.cad.step_reader._why(ChildRaised(json.dumps(report).encode()), ReadingLimits())
    assert said in text
    assert failed


def test_without_occt(monkeypatch):
    """The message says what to install; what was read before is still known."""
    content = packed(full_assembly(np.random.default_rng(1)))
    keep_answer(hashlib.sha256(LATCH.read_bytes()).hexdigest(), repr(1e-4), content)
    monkeypatch.setattr("engine.cad.step_reader.find_spec", lambda name: None)
    assert read_step(LATCH).parts
    with pytest.raises(CadError, match=r"clearcap\[cad\]"):
        read_step(LATCH, recognition=0.0)


@pytest.mark.slow
def test_the_reader_ends_with_its_parent(tmp_path):
    """Whoever starts it and is killed leaves nothing behind."""
    package = tmp_path / "OCP"
    package.mkdir()
    (package / "__init__.py").write_text(
        f"import os, time; open({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid())); time.sleep(3600)"
    )
    program = (
        "import sys, os, threading, time; from pathlib import Path; from engine.cad import read_step\n"
        f"pid = Path({str(tmp_path / 'pid')!r})\n"
        "threading.Thread(target=lambda: read_step(sys.argv[1], 1e-5), daemon=True).start()\n"
        "while not pid.exists() or not pid.read_text(): time.sleep(0.05)\n"
        "os.kill(os.getpid(), 9)"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])}
    subprocess.run([sys.executable, "-c", program, str(LATCH)], env=environment)
    reader = Path("/proc", (tmp_path / "pid").read_text())
    until(
        lambda: not reader.exists() or "Z" in (reader / "stat").read_text().split(")")[1],
        "the process that reads is still there",
    )


@pytest.mark.slow
def test_this_process_imports_no_occt():
    """Reading leaves OCP out of the process that asked."""
    program = "import sys; from engine.cad import read_step; read_step(sys.argv[1]); print('OCP' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program, str(LATCH)], capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr
