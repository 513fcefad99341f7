"""The command: exit statuses, one JSON document on standard output, one message for a fault of the input."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from datetime import datetime
from functools import partial
from importlib import resources
from pathlib import Path

import pytest
import tomli_w
from typer.testing import CliRunner

import campaign.coordinator.coordinate
import campaign.coordinator.submit
from campaign.coordinator.coordinate import coordinate
from campaign.row_build import short_build
from clearcap.cli import app, main
from clearcap.cli.output import LOGGED
from engine import read_trajectory
from tests.campaign import fake_engine
from tests.campaign.commands import ROOT, clearcap, clearcap_here
from tests.each import each
from tests.engine.kernels.surface_shapes import sphere_octant
from tests.house import modules

BAD_INPUT = {
    "unknown campaign": (["run", "c61"], "did you mean 'c60'?"),
    "unreadable campaign": (["run", "."], "cannot be read"),
    "no samples": (["run", "c60", "--samples", "0"], "samples = 0: must be at least 1"),
    "store not writable": (["run", "c60", "--store", "/proc/here"], "store /proc/here: not writable"),
    "server of a file": (["serve", "--store", __file__], "not writable (Not a directory)"),
    "store of one process": (["run", "c60", "--store", "memory://x"], "workers cannot reach"),
    "unknown joint": (["simulate", "c60", "--set", "J9=0.05"], "J9: unknown key"),
    "clearance 0": (["simulate", "c60", "--set", "J1=0"], "J1"),
    "clearance negative": (["simulate", "c60", "--set", "J1=-0.05"], "J1"),
    "clearance 1 mm": (["simulate", "c60", "--set", "J1=1"], "0.5"),
    "no number": (["simulate", "c60", "--set", "J1=x"], "--set J1=x: not KEY=VALUE with a number"),
    "no value": (["simulate", "c60", "--set", "J1"], "--set J1: not KEY=VALUE with a number"),
    "set twice": (["simulate", "c60", "--set", "J1=0.05", "--set", "J1=0.06"], "J1 is set twice"),
    "step negative": (["simulate", "c60", "--step", "-1"], "step"),
    "unknown trajectory": (["simulate", "incline", "--trajectory", "a.csv"], "allowed: .h5, .hdf5"),
    "unknown plot": (
        ["simulate", "incline", "--plot", "a.jpg"],
        "--plot a.jpg: unknown ending; allowed: .png, .svg, .pdf",
    ),
    "unknown animation": (["simulate", "incline", "--animate", "a.avi"], "allowed: .gif, .html, .mp4"),
    "unknown picture": (["mechanism", "show", "incline", "--picture", "a.gif"], "allowed: .png, .svg, .pdf"),
    "unknown figure": (["polarisation", "c60", "a.gif"], "allowed: .png, .svg, .pdf"),
    "no samples to polarise": (["polarisation", "c60", "a.png", "--samples", "0"], "--samples"),
    "polarisation of what": (["polarisation", "c61", "a.png"], "did you mean 'c60'?"),
    "no folder": (["simulate", "incline", "--trajectory", "none/a.h5"], "no folder none"),
    "every of nothing": (["simulate", "incline", "--every", "5"], "give --trajectory, --plot or --animate"),
    "every none": (["simulate", "incline", "--trajectory", "a.h5", "--every", "0"], "--every"),
    "bad value, good file": (["simulate", "incline", "--set", "J1=1", "--plot", "a.svg"], "J1: unknown key"),
    "unknown component": (
        ["simulate", "lever", "--set", "joints.pin.bearing.point.0=1"],
        "mean 'joints.pin.bearing.poi",
    ),
    "unknown parameter": (["simulate", "lever", "--set", "parameters.lnog=1"], "did you mean 'parameters.long'?"),
    "keys of nothing": (["mechanism", "show", "lever", "--keys", "stifness"], "no key of lever contains this"),
    "filter of nothing": (["mechanism", "show", "lever", "stop"], "a filter needs --keys; add --keys"),
    "a campaign as mechanism": (["simulate", "c60_corners"], "is a shipped campaign, not a mechanism; compute it with"),
    "unknown mechanism": (["mechanism", "check", "c6"], "did you mean 'c60'?"),
    "no store": (["status", "--store", "runs"], "store runs: no such folder; name the folder"),
    "typo in a status": (["rerun", "c60", "--status", "crased"], "'crased' is not one of"),
    "unknown id": (["report", "c60-0123456789", "--store", "."], "store .: holds no campaign"),
    "unknown option": (["run", "c60", "--sampels", "3"], "No such option"),
    "no workers": (["run", "c60", "--workers", "0"], "--workers"),
}


@each(("words", "said"), BAD_INPUT.values())
def test_bad_input(words, said, tmp_path, capsys, monkeypatch):
    """Exit 2, one message that names the fault, nothing on standard output, nothing written."""
    monkeypatch.chdir(tmp_path)
    code, output, messages = clearcap_here(capsys, monkeypatch, *words)
    assert code == 2, messages
    assert said in messages
    assert output == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.processes
def test_bad_campaign_file_writes_nothing(campaign_file):
    """A faulty file is refused before the store is touched."""
    campaign_file.write_text(campaign_file.read_text().replace("std = 0.0175", "std = -1"))
    done = clearcap("run", campaign_file, cwd=campaign_file.parent)
    assert (done.returncode, done.stdout) == (2, "")
    assert "variables.J1.std = -1: must be greater than 0" in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in campaign_file.parent.iterdir()] == ["demo.toml"]


def test_bug_is_not_hidden(monkeypatch):
    """Only errors made for the user become a message; a bug keeps its traceback."""
    monkeypatch.setattr("clearcap.cli.app", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main()


@pytest.mark.processes
def test_run_json(faked, campaign_file):
    """``run --json`` prints one document that says what was done; again, it computes nothing."""
    words = ["run", str(campaign_file), "--store", "s", "--workers", "1", "--json"]
    first = faked.invoke(app, words)
    assert first.exit_code == 0, first.output
    document = json.loads(first.stdout)
    asked = {"store": "s", "samples": 25, "ok": 25, "failed": 0, "computed": 25, "statuses": {"ok": 25}}
    assert asked.items() <= document.items()
    assert document["campaign"].startswith("demo-")
    assert document["wall_s"] > 0
    assert all(Path(path).is_file() for path in document["report"].values())
    assert "25/25 runs, 0 failed" in first.stderr
    again = json.loads(faked.invoke(app, words).stdout)
    assert again["computed"] == 0
    assert again["campaign"] == document["campaign"]


@pytest.mark.processes
def test_run_prints_capability(faked, campaign_file):
    """Without ``--json``: a table of responses with their Cpk, the counts, and where the report is."""
    done = faked.invoke(app, ["run", str(campaign_file), "--workers", "1"])
    assert done.exit_code == 0, done.output
    assert "Cpk" in done.stdout
    assert "FC-1" in done.stdout
    assert "25 runs: 25 ok" in done.stdout
    report = done.stdout.split("report: ")[1].strip()
    assert Path(report).is_file()


@pytest.mark.processes
def test_no_report(faked, campaign_file):
    """``--no-report`` writes rows only; ``report`` writes it later."""
    done = faked.invoke(app, ["run", str(campaign_file), "--workers", "1", "--no-report", "--json"])
    document = json.loads(done.stdout)
    folder = Path("runs") / document["campaign"] / "report"
    assert document["report"] == {}
    assert not folder.exists()
    later = json.loads(faked.invoke(app, ["report", "--json"]).stdout)
    assert {"html", "json", "parquet"} <= set(later["report"])
    assert folder.is_dir()


@pytest.mark.processes
def test_interrupt_says_how_to_go_on(faked, campaign_file, monkeypatch):
    """Ctrl-C exits 130 and prints the command that goes on; what is done is kept."""

    def interrupted(*rest, **options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(campaign.coordinator.coordinate, "coordinate", interrupted)
        done = faked.invoke(app, ["run", str(campaign_file), "--seed", "9", "--workers", "1"])
    assert done.exit_code == 130
    assert re.search(r"clearcap resume demo-[0-9a-f]{10} --workers 1 --store runs", done.stderr)
    assert json.loads(faked.invoke(app, ["status", "--json"]).stdout)["left"] == 25


@pytest.mark.processes
def test_not_one_success_is_a_failure(faked, campaign_file, monkeypatch):
    """A campaign without one result exits 1 and quotes a message; the rows stay."""
    raises = partial(fake_engine.raises_above, -1.0)
    monkeypatch.setattr(campaign.coordinator.coordinate, "coordinate", partial(coordinate, simulate=raises))
    done = faked.invoke(app, ["run", str(campaign_file), "--workers", "1", "--no-report", "--json"])
    assert done.exit_code == 1
    assert json.loads(done.stdout)["statuses"] == {"crashed": 25}
    assert "none of 25 runs succeeded (25 crashed)" in done.stderr
    assert "sample 0, crashed: ArithmeticError: no solution" in done.stderr


@pytest.mark.processes
def test_status(faked, campaign_file):
    """``status`` counts rows done, failed and left."""
    document = json.loads(faked.invoke(app, ["run", str(campaign_file), "--workers", "1", "--json"]).stdout)
    status = json.loads(faked.invoke(app, ["status", document["campaign"], "--json"]).stdout)
    assert 0 < datetime.fromisoformat(status.pop("since")).timestamp() <= time.time()
    assert status.pop("fault") is None
    assert status == {
        "campaign": document["campaign"],
        "store": "runs",
        "state": "completed",
        "message": "",
        "open": False,
        "heartbeat": None,
        "waits_for": "",
        "comparisons": {},
        "samples": 25,
        "done": 25,
        "ok": 25,
        "failed": 0,
        "left": 0,
        "statuses": {"ok": 25},
        "repeats": 1,
        "repeated": 1,
    }
    assert "25 of 25 done, 0 failed, 0 left, 1 of 1 repeats" in faked.invoke(app, ["status"]).stdout


def test_simulate_writes_what_is_asked_for(monkeypatch, tmp_path):
    """Trajectory, plot and animation of one run, named in the document; a run that fails has them too, and exits 1."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("clearcap.pictures.animation.FRAMES", 3)
    words = ["simulate", "clearance_pendulum", "--horizon", "0.05", "--every", "10", "--json"]
    done = CliRunner().invoke(app, [*words, "--trajectory", "a.h5", "--plot", "a.svg", "--animate", "a.gif"])
    assert done.exit_code == 1, done.output
    document = json.loads(done.stdout)
    assert document["status"] == "not_at_rest"
    assert document["files"] == {"trajectory": "a.h5", "plot": "a.svg", "animation": "a.gif"}
    assert {path.name for path in tmp_path.iterdir()} == {"a.h5", "a.svg", "a.gif"}
    assert len(read_trajectory("a.h5").time) == 26
    plot = (tmp_path / "a.svg").read_bytes()
    done = CliRunner().invoke(app, ["simulate", "incline", "--plot", "a.svg"])
    assert done.exit_code == 0, done.output
    assert done.stdout.endswith("plot: a.svg\n")
    assert (tmp_path / "a.svg").read_bytes() != plot


def test_film_without_ffmpeg_is_refused(monkeypatch, tmp_path):
    """``.mp4`` where there is no ffmpeg: exit 2 before the run, with what would do."""
    monkeypatch.setattr("clearcap.pictures.animation.can_write", lambda suffix: suffix != ".mp4")
    monkeypatch.setattr("sys.argv", ["clearcap", "simulate", "incline", "--animate", str(tmp_path / "a.mp4")])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert list(tmp_path.iterdir()) == []


def test_schemas(capsys, monkeypatch):
    """Both schemas are JSON Schema documents that know the tables of their format."""
    for which, table in (("campaign", "variables"), ("mechanism", "joints")):
        code, output, _ = clearcap_here(capsys, monkeypatch, "schema", which)
        assert code == 0
        assert table in json.loads(output)["properties"]


def test_mechanism_verbs(capsys, monkeypatch):
    """``list``, ``show`` and ``check`` of the shipped mechanisms, as JSON and as text."""

    def printed(*words):
        code, output, messages = clearcap_here(capsys, monkeypatch, "mechanism", *words)
        assert (code, messages) == (0, "")
        return output

    listed = json.loads(printed("list", "--json"))
    assert "c60" in [entry["name"] for entry in listed]
    shown = json.loads(printed("show", "c60", "--json"))
    assert shown["clearances"]["J1"]["unit"] == "mm"
    assert shown["responses"]["FC-1"]["unit"] == "N"
    assert shown["validity"]
    assert printed("check", "c60") == "c60: no errors\n"
    assert "FC-1 [N]" in printed("show", "c60")
    (preload,) = json.loads(printed("show", "c60", "--keys", "A3.preload", "--json"))
    assert (preload["key"], preload["value"], preload["unit"]) == ("springs.A3.preload", 0.9599, "rad")
    assert "joints.J1.radial_clearance" in printed("show", "c60", "--keys", "joints.J1.*")
    assert "motions.push.law.table.1.1" in printed("show", "c60", "--keys", "table", "--bench", "trip_pin")
    assert re.search(r"long += 30 mm", printed("show", "lever"))


@pytest.mark.processes
def test_version(tmp_path):
    """``--version`` prints the name, a version, and the build by which an image is named."""
    printed = clearcap("--version", cwd=tmp_path).stdout
    assert re.fullmatch(rf"clearcap \S+, build {short_build()}\n", printed)


def test_help_shows_options_without_a_value_as_such():
    """Typer writes a type behind each of them from 0.29 on; and it keeps line breaks of docstrings."""
    for words in ([], ["run"], ["mechanism"], ["mechanism", "import"], ["schema"]):
        done = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "200"})
        assert done.exit_code == 0
        assert "--help" in done.output
        assert "<bool>" not in done.output
        if words == ["run"]:
            assert "as campaigns of their own; the table decide of the campaign file" in done.output


@pytest.mark.processes
@pytest.mark.parametrize("words", [["--help"], ["mechanism", "list"], ["simulate", "none", "--set", "J1=1"]])
def test_help_is_quick(words, tmp_path):
    """Help and lists take 0.2 to 0.3 s: they wait for neither dask nor tables, nothing of them is imported.

    Nor is it for the mechanism of one run, which needs no samplers.
    """
    code = "import sys; from clearcap.cli import main; sys.argv = ['clearcap', *{words}]; main()"
    check = "import atexit, sys; atexit.register(lambda: print('LOADED', *sys.modules, file=sys.stderr)); "
    command = [sys.executable, "-c", check + code.replace("{words}", repr(words))]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    loaded = done.stderr.split("LOADED")[1].split()
    assert {"distributed", "pyarrow", "pandas", "numba", "matplotlib", "scipy", "h5py"}.isdisjoint(loaded)


@pytest.mark.processes
@pytest.mark.slow
def test_pictures_of_mechanism_and_campaign(tmp_path):
    """``show --picture`` and ``polarisation`` write their file and one document; nothing else is left."""
    shown = clearcap("mechanism", "show", "clearance_pendulum", "--picture", "a.svg", "--json", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert json.loads(shown.stdout)["name"] == "clearance_pendulum"
    drawn = clearcap("polarisation", "c60", "b.png", "--samples", 1, "--workers", 1, "--json", cwd=tmp_path)
    assert drawn.returncode == 0, drawn.stderr
    assert json.loads(drawn.stdout) == {"picture": "b.png", "samples": 1, "failed": 0}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.svg", "b.png"]


@pytest.mark.parametrize("verb", ["simulate", "report"])
def test_interrupted_verb_says_so(verb, store, plan, capsys, monkeypatch):
    """Ctrl-C in a verb that has nothing to continue: exit 130 and one message."""

    def interrupted(*_, **__):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("engine.simulate", interrupted)
    monkeypatch.setattr("clearcap.questions.report.report", interrupted)
    words = ["simulate", "incline"] if verb == "simulate" else ["report", "--store", store.url]
    try:
        code, output, messages = clearcap_here(capsys, monkeypatch, *words)
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a command that ends hears no second Ctrl-C
    assert (code, output) == (130, "")
    assert messages.splitlines()[-1] == f"clearcap: interrupted: clearcap {verb} ended without a result"


def test_campaign_against_itself(store, plan, capsys, monkeypatch):
    """A comparison of a campaign with itself is refused, under any name of it."""
    code, output, messages = clearcap_here(
        capsys, monkeypatch, "report", "--store", store.url, "--against", plan.campaign_id[:-1]
    )
    assert (code, output) == (2, "")
    assert "is the campaign itself; name another one, see: clearcap list --store" in messages


def test_check_warns_of_what_looks_wrong(tmp_path):
    """Gravity in m/s2 in a file in mm: one line, as data too, and exit status 0."""
    text = resources.files("engine.mechanism").joinpath("library", "c60.toml").read_text("utf-8")
    path = tmp_path / "own.toml"
    path.write_text(text.replace('units = "mm-g-ms"', 'units = "mm-g-ms"\ngravity = [0.0, -9.81, 0.0]'))
    done = CliRunner().invoke(app, ["mechanism", "check", str(path)])
    assert done.exit_code == 0, done.output
    assert f"warning: {path}: gravity = 9.81 mm/ms2: 1000 times the earth's" in done.stdout
    assert done.stdout.endswith("no errors, 1 warning\n")
    document = json.loads(CliRunner().invoke(app, ["mechanism", "check", str(path), "--json"]).stdout)
    assert [(entry["key"], entry["value"]) for entry in document["warnings"]] == [("gravity", 9.81)]


def test_check_states_the_error_of_surfaces_that_were_converted(tmp_path):
    """A ball over an eighth of a sphere: how many patches stand for it and how far they are from it, as data too."""
    text = resources.files("engine.mechanism").joinpath("library", "sphere_roll.toml").read_text("utf-8")
    side = {"body": "table", "surface": sphere_octant(0.5, conversion=1e-4)}
    document = {**tomllib.loads(text), "name": "own"}
    document["contacts"]["table"]["b"] = side
    document["bodies"]["ball"]["origin"] = [1.0, 1.0, 1.0]
    path = tmp_path / "own.toml"
    path.write_text(tomli_w.dumps(document))
    done = CliRunner().invoke(app, ["mechanism", "check", str(path)])
    assert done.exit_code == 0, done.output
    stated = re.search(r"contacts.table: (\d+) bicubic patches, no farther than (\S+) m from the B-spline", done.stdout)
    assert stated is not None
    assert 0 < float(stated[2]) <= 1e-4
    data = json.loads(CliRunner().invoke(app, ["mechanism", "check", str(path), "--json"]).stdout)["surfaces"]["table"]
    assert (data["patches"], data["unit"]) == (int(stated[1]), "m")
    assert data["error"] == pytest.approx(float(stated[2]), rel=0.05)


def test_simulate_gives_what_was_measured(tmp_path):
    """An event that does not come: the run is invalid, the response null, and the others have their values."""
    text = resources.files("engine.mechanism").joinpath("library", "incline.toml").read_text("utf-8")
    event = '[responses.late]\ntype = "time"\nat = { response = "slide", above = 1.0 }\n'
    path = tmp_path / "own.toml"
    path.write_text(f"{text}\n{event}")
    done = CliRunner().invoke(app, ["simulate", str(path), "--json"])
    assert done.exit_code == 1
    document = json.loads(done.stdout)
    assert document["status"] == "invalid"
    assert document["responses"]["late"] is None
    assert document["responses"]["slide"] == pytest.approx(0.0, abs=1e-6)
    assert re.search(r"^late +not measured$", CliRunner().invoke(app, ["simulate", str(path)]).stdout, re.M)


def test_a_step_longer_than_the_horizon_is_refused(capsys, monkeypatch):
    """Exit 2, with step and horizon."""
    code, _, said = clearcap_here(capsys, monkeypatch, "simulate", "c60", "--step", "1000")
    assert code == 2
    assert "simulation.step = 1000 ms: longer than simulation.horizon = 200 ms" in said


def test_what_our_packages_log_is_shown():
    """A module that logs is of a package whose log the command prints; the engine's compiler warns."""
    logging = {name for name, path in modules().items() if "getLogger(__name__)" in path.read_text()}
    assert {name.split(".")[0] for name in logging if not name.startswith("engine.jit.")} == set(LOGGED)
