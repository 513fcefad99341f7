"""No text that a user, a file or a store brings is ever markup: every verb of the command, with hostile names in all.

The verbs are those of the command itself. One that takes an argument which is not listed here fails until it is.
"""

import ast
import json
import shutil
import unicodedata
from dataclasses import fields
from functools import partial
from pathlib import Path
from uuid import uuid4

import pytest
from typer.main import get_command

from campaign.coordinator import rerun as rerunning
from campaign.spec.load import load_campaign
from clearcap.cli import app
from clearcap.cli.computing import verdicts_without_report
from clearcap.cli.output import INVISIBLE, visible
from engine.profile.step_times import StepTimes
from tests.campaign import fake_engine
from tests.campaign.commands import clearcap_here
from tests.campaign.conftest import *  # noqa: F403
from tests.campaign.driving import computed
from tests.each import each
from tests.house import ROOT, modules, syntax_tree

MARKUP = "[/x] [bold]b[/bold] [mm] [link=x]l[/link] {} {0} %s %(a)d $x_$ :smile: <b>"
HOSTILE = f"<BEGIN>\x1b]0;owned\x07\x1b[2J\u202e\u200b\x9b31m\nsecond\rline {MARKUP} {'long ' * 60}<END>"
FOLDER = "[bold] [/x] {} %s $HOME"
VARIABLE = "[/x] {} %s [bold]friction"
LIBRARY = ROOT / "engine" / "mechanism" / "library"


def leaves(command, path=()):
    """Yield the words and the command of every verb."""
    if hasattr(command, "commands"):
        for name, below in command.commands.items():
            yield from leaves(below, (*path, name))
    else:
        yield path, command


VERBS = dict(leaves(get_command(app)))


@pytest.fixture(scope="module")
def folder_of_hostile(tmp_path_factory):
    """Return a folder with a computed campaign whose every text is hostile, and the campaign's id."""
    folder = tmp_path_factory.mktemp("hostile")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, make_hostile()


def make_hostile():
    """Compute a campaign whose every text is hostile, in the current folder; return its id."""
    text = (LIBRARY / "incline.toml").read_text().replace("from =", "unit_ = 0\nfrom =").replace("unit_ = 0\n", "")
    for plain in ("Block on a slope", "way down the slope", "A block of 0.2 x 0.2 x 0.1 m on four corners"):
        text = text.replace(f'"{plain}', f'"{quoted(HOSTILE)}')
    Path("mechanism [x].toml").write_text(text)
    Path("parts [x].csv").write_text("\n".join([f'"{MARKUP}"', *(f"10.{digit}" for digit in range(10))]))
    measured = (f'"part {MARKUP} {row % 3}",10.{row % 7}' for row in range(12))
    Path("gauge [x].csv").write_text("\n".join([f'"{MARKUP}",value', *measured]))
    Path("bench [x].toml").write_text(
        f'constants = ["{quoted(VARIABLE)}"]\n[[measurements]]\nresponse = "slide"\nvalue = 10.7\nsigma = 0.1\n'
        f'specimen = "{quoted(MARKUP)}"\n'
    )
    Path("friction [x].csv").write_text("\n".join([f'"{MARKUP}"', *(f"{0.66 + row / 500}" for row in range(40))]))
    Path("friction [x].toml").write_text(f'[characteristics."{quoted(VARIABLE)}"]\ncolumn = "{quoted(MARKUP)}"\n')
    Path("slide [x].toml").write_text(f'[characteristics.slide]\ncolumn = "{quoted(MARKUP)}"\nunit = "m"\n')
    Path("limits [x].toml").write_text(
        f'title = "{quoted(HOSTILE)}"\nheader = {{ "{quoted(MARKUP)}" = "{quoted(HOSTILE)}" }}\n'
        f'[characteristics."{quoted(MARKUP)}"]\nunit = "{quoted(MARKUP)}"\ntitle = "{quoted(HOSTILE)}"\n'
        f'lsl = 9.0\nusl = 11.0\nsource = "{quoted(HOSTILE)}"\n'
    )
    Path("campaign [x].toml").write_text(
        'format = 1\nname = "demo"\nmechanism = "./mechanism [x].toml"\nsamples = 40\n'
        f'title = "{quoted(HOSTILE)}"\nheader = {{ "author {quoted(MARKUP)}" = "{quoted(HOSTILE)}" }}\n'
        f'[variables."{quoted(VARIABLE)}"]\ntarget = "materials.block_slope.friction"\n'
        'distribution = "truncated_normal"\nmean = 0.7\nstd = 0.02\nlower = 0.6\nupper = 0.8\n'
        f'[responses.slide]\nlsl = 9.0\nusl = 11.5\nsource = "{quoted(HOSTILE)}"\n'
    )
    store, plan = computed("runs", load_campaign("campaign [x].toml"), 40)
    store.write_json(plan.campaign_id, "state.json", {"state": "completed", "message": HOSTILE})
    return plan.campaign_id


@pytest.fixture
def hostile(faked, folder_of_hostile, tmp_path, monkeypatch):
    """Return what puts a copy of the campaign into a folder with a hostile name, stands there, and returns its id."""
    monkeypatch.setenv("COLUMNS", "20000")
    monkeypatch.setattr(rerunning, "rerun", partial(rerunning.rerun, simulate=fake_engine.simulate))
    monkeypatch.setattr("clearcap.questions.report.report", lambda *_, **__: {"html": f"{FOLDER}/{visible(HOSTILE)}"})
    monkeypatch.setattr("clearcap.cli.computing.reported_verdicts", lambda _, p: verdicts_without_report(p, {"ok": 40}))
    monkeypatch.setattr("engine.profile.step_times.measure_step_times", slow_steps)
    monkeypatch.setattr("clearcap.questions.mechanisms.campaign_journal_positions", lambda *_: [])
    made, campaign_id = folder_of_hostile

    def fresh():
        folder = tmp_path / uuid4().hex / FOLDER  # its name has a slash
        shutil.copytree(made, folder)
        monkeypatch.chdir(folder)
        return campaign_id

    return fresh


def quoted(text):
    """Return a text as TOML has it between quotes."""
    return json.dumps(text)[1:-1].replace("\x7f", "\\u007F")


def slow_steps(mechanism, steps):
    """Return a measurement of a mechanism with hostile texts, without measuring."""
    texts = {"mechanism": HOSTILE, "status": "ok", "message": HOSTILE, "shares": {"solver": 1.0}}
    return StepTimes(**{field.name: texts.get(field.name, 1.0) for field in fields(StepTimes)})


def words_of(verb, campaign_id):
    """Return sound words for every argument of a verb, and for the options without which it does nothing."""
    sound = {
        "mechanism": ["mechanism [x].toml"],
        "mechanisms": ["mechanism [x].toml"],
        "campaign": ["campaign [x].toml" if verb[0] in ("run", "submit", "polarisation") else campaign_id],
        "picture": ["picture [bold] {} %s.png"],
        "sample": ["3"],
        "folder": [FOLDER],
        "export": [f"runs/{campaign_id}"],
        "file": ["backup [x].zip"],
        "parts": ["friction [x].csv" if verb == ("monitor",) else "parts [x].csv"],
        "table": ["gauge [x].csv"],
        "measurements": ["bench [x].toml"],
        "pattern": ["*"],
        "step_file": [str(ROOT / "docs" / "examples" / "latch.step")],
    }
    words = []
    for parameter in VERBS[verb].params:
        if parameter.param_type_name == "argument":
            assert parameter.name in sound, f"{' '.join(verb)}: say here what its argument {parameter.name} may be"
            words += sound[parameter.name]
    options = {
        ("submit",): ["--queue-only"],
        ("delete",): ["--yes"],
        ("capability",): ["--limits", "limits [x].toml"],
        ("gauge",): ["--part", MARKUP],
        ("validate",): ["--limits", "slide [x].toml"],
        ("monitor",): ["--limits", "friction [x].toml"],
        ("whatif",): ["--set", f"{VARIABLE}.std=0.019"],
        ("mechanism", "show"): ["--keys"],
        ("mechanism", "import"): ["--output", f"imported-{uuid4().hex}.toml"],
        ("mechanism", "plain"): ["--output", f"plain-{uuid4().hex}.toml"],
        ("serve",): ["--login-link", "admin", "--data", "served"],
        ("rerun",): ["--sample", "3", "--workers", "1"],
    }
    return [*words, *options.get(verb, [])]


def check(output, messages):
    """Check that a terminal obeys nothing of what a verb printed, and that hostile texts are whole."""
    for text in (output, messages):
        assert [c for c in text if unicodedata.category(c) in INVISIBLE and c != "\n"] == []
    for text in (output.replace("\n  ", "\n"), messages.replace("\n  ", "\n")):
        whole = text.count(visible(HOSTILE)) + text.count(visible(HOSTILE, "\n"))
        assert text.count("<BEGIN>") == whole, "a hostile text is not whole"


@pytest.mark.processes
@each("as_json", [False, True])
@each("verb", VERBS)
def test_hostile_texts(verb, as_json, hostile, capsys, monkeypatch):
    """A verb at work on hostile texts: all whole, none obeyed; with ``--json`` one document and nothing else."""
    words = [*verb, *words_of(verb, hostile()), *(["--json"] if as_json else [])]
    code, output, messages = clearcap_here(capsys, monkeypatch, *words)
    is_of_a_server = verb in (("backup",), ("restore",))  # here is none, which is said of a file or folder
    assert code in ((2,) if is_of_a_server else (0, 1)), messages
    if is_of_a_server:
        return
    if not as_json:
        check(output, messages)
        assert verb != ("whatif",) or "slide [m]" in output, "a unit is taken for markup"
        return
    check("", messages)
    if output or code == 0:
        json.loads(output)


@pytest.mark.processes
@each("verb", VERBS)
def test_hostile_words(verb, hostile, capsys, monkeypatch):
    """Markup in place of each argument and of each option's value: no bug, and the message quotes it whole."""
    campaign_id = hostile()
    for parameter in VERBS[verb].params:
        if getattr(parameter, "is_flag", False) or parameter.name in ("help", "json"):
            continue
        words = words_of(verb, campaign_id)
        if parameter.param_type_name == "argument":
            arguments = [p.name for p in VERBS[verb].params if p.param_type_name == "argument"]
            words[arguments.index(parameter.name)] = MARKUP
        else:
            words += [parameter.opts[0], MARKUP]
        code, output, messages = clearcap_here(capsys, monkeypatch, *verb, *words)
        assert code in (0, 1, 2, 4), (parameter.name, messages)
        check(output, messages)
        assert messages.count("%(a)d") == messages.count(MARKUP), (parameter.name, messages)


# The one way to print: who calls these, or reads markup, is `output`.
PRINTERS = {"clearcap.cli.output", "campaign.interrupts"}


def test_one_way_to_print():
    """Outside of `output` nothing prints, makes a console, or turns markup on."""
    found = []
    for module in modules():
        for node in ast.walk(syntax_tree(module)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rich") and module not in PRINTERS:
                found.append(f"{module} imports {node.module}")
            name = getattr(node.func, "attr", getattr(node.func, "id", "")) if isinstance(node, ast.Call) else ""
            if name in ("print", "echo", "secho", "rprint") and module not in PRINTERS:
                found.append(f"{module} calls {name}")
            if name in ("from_markup", "render"):
                found.append(f"{module} calls {name}") if module.startswith("clearcap.cli") else None
            if isinstance(node, ast.keyword) and node.arg in ("markup", "emoji") and ast.unparse(node.value) != "False":
                found.append(f"{module} turns {node.arg} on")
    assert found == []
    assert "markup=False" in modules()["clearcap.cli.output"].read_text()
