"""The command in tests: in a process of its own, or in this one, which takes no time to start."""

import logging
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from clearcap.cli import main
from clearcap.cli.output import LOGGED

ROOT = Path(__file__).parents[2]


def clearcap(*words, cwd):
    """Run the command in a process of its own."""
    command = [sys.executable, "-m", "clearcap", *map(str, words)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)


def clearcap_here(capsys, monkeypatch, *words):
    """Run the command in this process, where it ends with an exit status; return that and both outputs."""
    monkeypatch.setattr(sys, "argv", ["clearcap", *map(str, words)])
    with _logging_kept(), pytest.raises(SystemExit) as ending:
        main()
    return (ending.value.code, *capsys.readouterr())


@contextmanager
def _logging_kept():
    """Take back what the command sets for its whole process."""
    loggers = [logging.getLogger(name) for name in LOGGED]
    before = [(logger, logger.handlers[:], logger.level) for logger in loggers]
    try:
        yield
    finally:
        for logger, handlers, level in before:
            logger.handlers[:] = handlers
            logger.setLevel(level)
