"""What `make audit` makes of what is known of the locked packages."""

import importlib.util
import re
import stat
import sys
from datetime import date
from pathlib import Path

import pytest

DEPLOY = Path(__file__).parents[2] / "deploy"
TODAY = date(2026, 11, 22)


@pytest.fixture
def audit():
    """Return deploy/audit.py as a module."""
    spec = importlib.util.spec_from_file_location("audit", DEPLOY / "audit.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def package(**fault):
    """Return a package with a known fault, as pip-audit reports it."""
    vulns = [{"id": "PYSEC-2026-1", "fix_versions": [], "aliases": ["CVE-2026-9"], **fault}]
    return {"name": "gadget", "version": "1.0", "vulns": vulns}


FINE = {"name": "widget", "version": "2.0", "vulns": []}
SKIPPED = {"name": "novel", "skip_reason": "not found"}


def passed_over(until):
    """Return a table of audit.toml."""
    return [{"id": "CVE-2026-9", "reason": "not called", "until": until}]


def test_a_fault_that_is_mended_fails(audit):
    """And the line says in which version."""
    lines, status = audit.judge([FINE, package(fix_versions=["1.1"])], [], TODAY)
    assert status == 1
    assert lines == ["gadget 1.0: PYSEC-2026-1 is fixed in 1.1: make lock", "2 of 2 locked packages audited"]


def test_a_fault_that_nothing_mends(audit):
    """It is said, and fails nothing: there is nothing to do."""
    lines, status = audit.judge([package()], [], TODAY)
    assert status == 0
    assert lines[0] == "gadget 1.0: PYSEC-2026-1 is not fixed in any version yet"


def test_passed_over_until_a_day(audit):
    """By any of its names, with its reason; after the day it fails again."""
    fixed = package(fix_versions=["1.1"])
    lines, status = audit.judge([fixed], passed_over(TODAY), TODAY)
    assert status == 0
    assert lines[0] == "gadget 1.0: PYSEC-2026-1 passed over until 2026-11-22: not called"
    assert audit.judge([fixed], passed_over(date(2026, 11, 21)), TODAY)[1] == 1


def test_what_the_service_does_not_know(audit):
    """It is said loudly and counted: no answer is not the same as no fault."""
    lines, status = audit.judge([FINE, SKIPPED], [], TODAY)
    assert status == 0
    assert lines == ["NOT AUDITED: the service knows nothing of 1 packages: novel", "1 of 2 locked packages audited"]


@pytest.mark.parametrize(
    ("prints", "said"),
    [
        ("echo 'no route' >&2; exit 1", "NOT AUDITED: .* no route"),
        ("exit 3", "NOT AUDITED: .* exit status 3"),
        ("echo nonsense", "NOT AUDITED"),
        ("echo '{}'", "NOT AUDITED"),
        ("sleep 60", "NOT AUDITED: .* timed out"),
        ("""echo '{"dependencies": []}'""", "0 of 0 locked packages audited"),
    ],
)
def test_a_service_out_of_reach(audit, prints, said, tmp_path, monkeypatch, capsys):
    """Whatever pip-audit does, the audit ends, says what is not audited, and fails nothing."""
    stand_in = tmp_path / "python"
    stand_in.write_text(f"#!/bin/sh\n{prints}\n")
    stand_in.chmod(stand_in.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(sys, "executable", str(stand_in))
    monkeypatch.setattr(audit, "WITHIN", 1 if "sleep" in prints else 600)
    assert audit.main() == 0
    assert re.match(said, capsys.readouterr().out)
