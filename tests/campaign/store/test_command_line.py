"""Commands that are printed to be typed again have all that they need."""

import ast
import re
import shlex

from campaign.environment import STORE
from campaign.store import open_store
from tests.house import modules, syntax_tree

# Verbs on a store, in a text that is no part of a command which `command_line` made.
PRINTED = re.compile(
    r"clearcap (?:resume|rerun|replay|report|watch|cancel|status|coordinate|compact|delete|list|whatif|advise|design)\b"
)
PROSE = {
    # A command on a server, which has its address.
    "campaign.client.remote_server",
    # What takes a folder or file: the store is that folder, or the one above it.
    "engine.faults.file_kinds",
    # What a sampler is for: it names the verb.
    "campaign.inputs.sampling.importance",
    # A row is the same in every store, so it names none.
    "campaign.worker.subprocess_runs",
    # Sentences of a report, which knows no store; they name a verb and are no command.
    "reporting.sensitivity.total_order",
    "reporting.trust.rare_shares",
}


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
    """Each command on a store comes from `command_line`."""
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
