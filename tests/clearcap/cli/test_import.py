"""`clearcap mechanism import`: from a STEP file to files that load, and what `check` says of them."""

import json
import re
import shutil
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from campaign.coordinator.submit import plan_campaign
from campaign.plan import Plan, make_plan
from campaign.spec.load import load_campaign
from clearcap.cli import app
from clearcap.questions.mechanisms import geometry_provenance
from clearcap.questions.report import provenance
from engine import load_mechanism
from engine.jit import CACHE_FOLDER
from tests.engine.mechanism.geometry.latch_file import LATCH

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the latch's STEP file and a cache."""
    folder = tmp_path_factory.mktemp("import")
    shutil.copy(LATCH, folder / "latch.step")
    return folder


@pytest.fixture(autouse=True)
def here(folder, monkeypatch):
    """Be in the folder, and keep nothing in the user's cache."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))


def clearcap(*words):
    done = CliRunner().invoke(app, ["mechanism", *words])
    assert done.exit_code == 0, done.exception
    return done.stdout


def test_import_and_check(folder):
    """What is found is printed, the questions too; `check` prints them again, and the certificate."""
    printed = clearcap("import", "latch.step", "-o", "latch.toml")
    assert "joint base-crank: base in crank, radii 3.05 and 3, clearance 0.05, axial play 0.05, 0.05 mm" in printed
    assert "facing stop-1: base and crank, 0.8 mm apart" in printed
    assert printed.endswith("written: latch.toml, latch-campaign.toml, latch.svg, latch.html; 6 questions are open\n")
    assert "Nothing acts yet on rocker along z" in printed
    checked = clearcap("check", "latch.toml")
    assert "question: latch.toml, line 8: gravity: which way is down?" in checked
    assert "joints.base-rocker: clearance 0.06 mm as drawn, axes 0 mm apart and 0 rad tilted" in checked
    assert "bodies.crank: part crank, 2497.53 mm3, 19.6056 g by the density of the CAD file (steel)" in checked
    assert "joints.base-rocker: 0.06 mm apart as OCCT measures, gap at the start 0.06 mm, difference " in checked
    assert checked.endswith("6 open questions\n")
    document = json.loads(clearcap("check", "latch.toml", "--json"))
    assert document["geometry"]["joints"]["base-rocker"]["clearance"] == pytest.approx(0.06, abs=1e-9)
    assert document["questions"][0]["line"] == 8
    again = CliRunner().invoke(app, ["mechanism", "import", "latch.step", "-o", "latch.toml"])
    assert "exists already" in str(again.exception)


def test_json(folder):
    """The same as data."""
    document = json.loads(clearcap("import", "latch.step", "-o", "other.toml", "--json"))
    assert [part["name"] for part in document["parts"]] == ["base", "crank", "rocker", "coupler"]
    assert [joint["pin_radius"] for joint in document["joints"]] == pytest.approx([3.0, 3.0, 2.5, 2.5], abs=1e-9)
    assert document["written"] == ["other.toml", "other-campaign.toml", "other.svg", "other.html"]
    assert len(document["questions"]) == 6


def test_the_campaign_of_limits(folder):
    """The limits in the STEP file vary the clearance; plan and provenance hold the certificate."""
    clearcap("import", "latch.step", "-o", "limits.toml", "--no-pictures")
    assert not (folder / "limits.html").exists()
    campaign = load_campaign("limits-campaign.toml")
    hole = campaign.spec.variables["base_crank_hole"]
    assert (hole.nominal, hole.tolerance) == (pytest.approx(6.105, abs=1e-9), pytest.approx(0.015, abs=1e-9))
    plan = make_plan(campaign)
    again = Plan.from_json(plan.to_json())
    assert again.mechanism.geometry == campaign.mechanism.geometry
    assert {key: gap.gap for key, gap in again.mechanism.geometry.gaps.items()} == pytest.approx(
        {f"joints.{name}": joint.radial_clearance for name, joint in campaign.mechanism.joints.items()}, abs=1e-9
    )
    assert again.campaign_id == plan.campaign_id
    listed = provenance(again)
    assert listed["CAD file"] == "latch.step"
    assert listed["sha256 of the CAD file"] == again.mechanism.geometry.sha256
    assert "4 bodies, 8 faces" in listed["geometry from it"]
    assert listed["gaps at the start"].startswith("4 compared with OCCT's distances, largest difference ")
    assert geometry_provenance(None) == {}


def test_open_questions_of_a_campaign(folder, caplog):
    """Whoever submits or runs a campaign whose questions are open is told so, with their lines."""
    clearcap("import", "latch.step", "-o", "asked.toml")
    plan_campaign("asked-campaign.toml", "store", batch_size=10)
    said = [record.getMessage() for record in caplog.records]
    assert "question: asked-campaign.toml, line 3: variables: with which Cpk, or which distribution" in said[0]
    assert "question: asked-campaign.toml, line 4: responses: what are the limits" in said[1]
    caplog.clear()
    plan_campaign("asked-campaign.toml", "store", batch_size=10)
    assert not caplog.records


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["none.step", "-o", "x.toml"], "cannot be read"),
        (["latch.step", "-o", "x.txt"], "unknown ending"),
        (["latch.toml", "-o", "x.toml"], "is not a STEP file"),
    ],
)
def test_refused(folder, words, said):
    """Nothing is written where something is wrong."""
    (folder / "latch.toml").touch()
    done = CliRunner().invoke(app, ["mechanism", "import", *words])
    assert said in str(done.exception) or "is empty" in str(done.exception)
    assert not (folder / "x.toml").exists()


@pytest.mark.slow
@pytest.mark.processes
def test_without_the_extra(folder):
    """Where OCCT is not installed, `import` says what to install, and others work, with the kernels of this process."""
    hide = "import sys; sys.modules['OCP'] = None; sys.argv = ['clearcap', *{words!r}]"
    code = hide + "; from clearcap.cli import main; main()"

    def run(*words):
        return subprocess.run(
            [sys.executable, "-c", code.format(words=words)],
            capture_output=True,
            text=True,
            env={
                "XDG_CACHE_HOME": str(folder / "none"),
                "NUMBA_CACHE_DIR": str(CACHE_FOLDER.parent),
                "PATH": "",
                "HOME": str(folder),
            },
        )

    refused = run("mechanism", "import", "latch.step", "-o", "y.toml")
    assert (refused.returncode, "pip install 'clearcap[cad]'" in refused.stderr) == (2, True)
    assert run("mechanism", "check", "lever").returncode == 0


@pytest.mark.slow
def test_update(folder):
    """A revision whose faces are the same: only the SHA-256 and the file follow, as a diff; answers stay."""
    clearcap("import", "latch.step", "-o", "kept.toml", "--no-pictures")
    path = folder / "kept.toml"
    path.write_text(path.read_text().replace("friction = 0.0", "friction = 0.3"))
    (folder / "latch_B.step").write_bytes((folder / "latch.step").read_bytes().replace(b"DATA;", b"DATA;\n/* B */", 1))
    printed = clearcap("import", "latch_B.step", "--update", "kept.toml")
    assert '-file = "latch.step"' in printed
    assert '+file = "latch_B.step"' in printed
    assert "friction" not in printed
    assert "friction = 0.3" in path.read_text()
    load_mechanism(path)
    assert clearcap("import", "latch_B.step", "--update", "kept.toml") == "kept.toml: nothing has changed\n"
    assert json.loads(clearcap("import", "latch_B.step", "--update", "kept.toml", "--json"))["changes"] == []


@pytest.mark.slow
def test_update_of_limits(folder):
    """New limits follow in the campaign file, too; a recognition gap that was asked for stays."""
    clearcap("import", "latch.step", "-o", "revised.toml", "--no-pictures", "--recognition", "1e-3")
    path = folder / "revised-campaign.toml"
    path.write_text(path.read_text().replace("cpk = 1.33", "cpk = 1.67", 1).replace("samples = 1000", "samples = 7"))
    limits = (
        (folder / "latch.step").read_text("latin-1").replace("MEASURE_WITH_UNIT(-1.E-02", "MEASURE_WITH_UNIT(-3.E-02")
    )
    (folder / "latch_C.step").write_text(limits, "latin-1")
    printed = clearcap("import", "latch_C.step", "--update", "revised.toml")
    assert "+base_crank_hole = 6.1                # mm, 6.07 to 6.12 in the CAD file" in printed
    assert "recognition" not in printed.replace(" recognition = 0.001\n", "")
    assert printed.endswith("written: revised.toml, revised-campaign.toml; 8 questions are open\n")
    hole = load_campaign("revised-campaign.toml").spec.variables["base_crank_hole"]
    assert (hole.nominal, hole.tolerance, hole.cpk) == (6.095, 0.025, 1.67)
    assert "samples = 7\n" in path.read_text()
    path.unlink()
    clearcap("import", "latch.step", "--update", "revised.toml")
    assert not path.exists()  # whoever has moved it has it elsewhere


@pytest.mark.slow
def test_pictures_are_not_written_over(folder):
    """A file of a picture's name is kept and named, and nothing is written; with `--update` it must be said."""
    for name in ("drawn.svg", "drawn.html"):
        (folder / name).write_text("mine")
        refused = CliRunner().invoke(app, ["mechanism", "import", "latch.step", "-o", "drawn.toml"])
        assert f"{name}: exists already" in str(refused.exception)
        assert "--no-pictures" in str(refused.exception)
        assert (folder / name).read_text() == "mine"
        assert not (folder / "drawn.toml").exists()
        (folder / name).unlink()
    clearcap("import", "latch.step", "-o", "drawn.toml")
    (folder / "drawn.html").write_text("mine")
    clearcap("import", "latch.step", "--update", "drawn.toml")
    assert (folder / "drawn.html").read_text() == "mine"
    printed = clearcap("import", "latch.step", "--update", "drawn.toml", "--pictures")
    assert printed == "drawn.toml: nothing has changed\nwritten: drawn.svg, drawn.html\n"
    text, drawing = (folder / "drawn.html").read_text(), (folder / "drawn.svg").read_text()
    assert "latch.step: what was found" in text
    assert "base-crank" in drawing
    assert "radii 3.05 and 3" in drawing
    assert "stop-1" in drawing


@pytest.mark.slow
def test_a_damaged_file_is_refused_unless_it_is_accepted(folder):
    """A face does not say which way it looks: nothing is written, until somebody says that the rest will do."""
    whole = (folder / "latch.step").read_text("latin-1")
    missing = re.sub(r"(ADVANCED_FACE\('',\([^)]*\),#\d+,)\.T\.", r"\g<1>$", whole, count=1)
    (folder / "damaged.step").write_text(missing, "latin-1")
    words = ["import", "damaged.step", "-o", "damaged.toml", "--no-pictures"]
    refused = CliRunner().invoke(app, ["mechanism", *words])
    assert "damaged.step: is damaged: 1 of its entities cannot be read" in str(refused.exception)
    assert not (folder / "damaged.toml").exists()
    assert "left out: what 1 of the file's " in clearcap(*words, "--accept-damage")
    text = (folder / "damaged.toml").read_text()
    printed = clearcap("check", "damaged.toml")
    assert (
        "warning: damaged.toml: cad.file: damaged.step is damaged, and what 1 of its entities describe of base"
        in printed
    )
    (folder / "by_hand.toml").write_text(text.replace("accept_damage = true\n", ""))
    refused = CliRunner().invoke(app, ["mechanism", "check", "by_hand.toml"])
    assert "cad.file = 'damaged.step': is damaged: 1 of its entities cannot be read" in str(refused.exception)
    assert "or take what is left with accept_damage = true beside it" in str(refused.exception)


def test_one_of_two_options(folder):
    """Either a new file or an earlier one."""
    done = CliRunner().invoke(app, ["mechanism", "import", "latch.step"])
    assert "one of --output and --update" in str(done.exception)
