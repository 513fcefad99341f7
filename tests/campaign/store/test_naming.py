"""Which campaign is meant by an id or its first letters, and commands to be typed again that have all they need."""

import ast
import re
import shlex

import pytest

from campaign.errors import SpecError
from campaign.plan import make_plan
from campaign.processes import STORE
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.layout import DECISION
from tests.house import modules, syntax_tree

# Verbs on a store, in a text that is no part of a command which `Files.command` made.
PRINTED = re.compile(
    r"clearcap (?:resume|rerun|replay|report|watch|cancel|status|coordinate|compact|delete|list|whatif|advise|design)\b"
)
PROSE = {
    # A command on a server, which has its address.
    "clearcap.client.remote_server",
    # What takes a folder or file: the store is that folder, or the one above it.
    "engine.faults.file_kinds",
    # What a sampler is for: it names the verb.
    "campaign.inputs.sampling.importance",
    # A row is the same in every store, so it names none.
    "campaign.worker.batch",
    # Sentences of a report, which knows no store; they name a verb and are no command.
    "reporting.sensitivity.total_order",
    "reporting.trust.evidence",
}


def test_which_campaign(store, plan, campaign_file):
    """The only campaign need not be named; several must be, and an unknown one is refused with the list."""
    assert store.find(None) == plan.campaign_id
    other = make_plan(load_campaign(str(campaign_file), seed=1))
    store.create_plan(other)
    assert store.find(other.campaign_id) == other.campaign_id
    for campaign_id in (None, "../etc", "demo", ""):
        with pytest.raises(SpecError, match=plan.campaign_id):
            store.find(campaign_id)


def test_first_letters(store, plan, campaign_file):
    """As many letters as tell it from the others; a whole id is itself, though another one begins with it."""
    other = make_plan(load_campaign(str(campaign_file), seed=1))
    store.create_plan(other)
    differ = next(n for n in range(5, 15) if plan.campaign_id[:n] != other.campaign_id[:n])
    assert store.find(plan.campaign_id[:differ]) == plan.campaign_id
    with pytest.raises(SpecError, match=r"demo- .*several"):
        store.find("demo-")
    longer = f"{plan.campaign_id}x"
    store.files.write(f"{longer}/plan.json", b"{}")
    assert store.find(plan.campaign_id) == plan.campaign_id
    assert store.find(longer) == longer


def test_what_decides_a_campaign_is_meant_by_its_own_name_only(store, plan, campaign_file):
    """After `run` there are two, and one was asked for."""
    aimed = make_plan(load_campaign(str(campaign_file), seed=2))
    store.create_plan(aimed)
    stages = [{"campaign": aimed.campaign_id, "responses": ["FC-1"]}]
    store.write_json(plan.campaign_id, DECISION, {"stages": stages})
    for wanted in (None, "demo", plan.campaign_id):
        assert store.find(wanted) == plan.campaign_id
    assert store.find(aimed.campaign_id) == aimed.campaign_id
    store.create_plan(make_plan(load_campaign(str(campaign_file), seed=3)))
    with pytest.raises(SpecError, match="several"):
        store.find("demo")


def test_no_store(store, plan, tmp_path):
    """A folder that is not there, a file, one campaign's folder, and an empty store: each is said, with what to do."""
    (tmp_path / "file").write_text("x")
    (tmp_path / "empty dir").mkdir()
    said = {
        "nowhere": "no such folder; name the folder of your results with --store, or make one: clearcap run CAMPAIGN",
        "file": "is a file, not a folder of campaigns",
        "file/below": "no such folder",
        "empty dir": "holds no campaign; make one: clearcap run CAMPAIGN --store '.*empty dir'",
        f"runs/{plan.campaign_id}": f"is the folder of one campaign, not a store; write {plan.campaign_id} --store ",
    }
    for name, message in said.items():
        for campaign_id in (None, plan.campaign_id):
            with pytest.raises(SpecError, match=message):
                open_store(str(tmp_path / name)).find(campaign_id)


def texts(tree):
    """Yield the texts of a module but its docstrings."""
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield node.value


def test_no_command_is_written_by_hand():
    """Each command on a store comes from `Files.command`."""
    found = {name for name in modules() if any(PRINTED.search(text) for text in texts(syntax_tree(name)))}
    assert found - PROSE == set()


def test_store_is_named(tmp_path, monkeypatch):
    """The store and odd words of it, as a shell reads them; a password only where the user writes it."""
    monkeypatch.delenv(STORE, raising=False)
    odd = open_store(str(tmp_path / "a b; rm $HOME"))
    assert shlex.split(odd.command("replay", "x-1", "7")) == ["clearcap", "replay", "x-1", "7", "--store", odd.url]
    assert open_store("runs").command("list") == "clearcap list --store runs"
    secret = "http://user:secret123@host/x"
    assert shlex.split(open_store(secret).command("list"))[-1] == "http://user:***@host/x"
    monkeypatch.setenv(STORE, secret)
    assert open_store(secret).command("list") == "clearcap list"
