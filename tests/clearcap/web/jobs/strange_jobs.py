"""Jobs that end in all the ways in which jobs end."""

import datetime
import os
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from campaign.errors import SpecError, StoreError
from campaign.store import open_store
from tests.until import until


def add(a, b):
    """Return a sum as data."""
    return {"sum": a + b, "process": os.getpid()}


def raw(size):
    """Return bytes as they are."""
    return b"\n\0" * (size // 2)


def odd_numbers():
    """Return what JSON has no word for."""
    return {"values": (float("nan"), float("inf"), 1.5)}


def environment():
    """Return the environment of the process."""
    return dict(os.environ)


def sleep(seconds):
    """Take time, but no processor."""
    time.sleep(seconds)
    return "slept"


def hold(folder):
    """Wait until there is a file ``go`` in a folder."""
    until(Path(folder, "go").exists, "a file go")
    return "held"


def spin():
    """Take all processor time there is."""
    while True:
        pass


def eat():
    """Take all memory there is."""
    kept = []
    while True:
        kept.append(bytearray(1 << 26))


def crash():
    """End the process by a signal."""
    os.kill(os.getpid(), signal.SIGSEGV)


def leave():
    """End the process as a bug would."""
    os._exit(7)


def wrong_input():
    """Refuse the input, with faults as data."""
    error = SpecError("variables.J1.std: -1: must be above 0")
    error.faults = [{"key": "variables.J1.std", "value": datetime.date(2026, 1, 2)}]  # TOML has dates, JSON none
    raise error


def store_away():
    """Fail to reach the store."""
    raise StoreError("store s3://x: cannot be reached")


def bug():
    """Fail for a reason of the program's own."""
    raise KeyError("secret detail")


def answer_by_a_bug(*_):
    """Fail for a reason of the program's own, whatever is asked."""
    bug()


def read_what_was_deleted(asked, *_):
    """Read a file of a campaign that somebody has deleted meanwhile."""
    open_store(asked.store).files.read("deleted-1234567890/plan.json")


def answer_too_much(*_):
    """Answer more than fits into any answer, whatever is asked."""
    return bytes(65 << 20)


def print_something():
    """Print where only answers belong."""
    print("noise")
    return "said"


def start_child(note):
    """Start a process of its own, note its number and wait for it."""
    child = subprocess.Popen(["sleep", "600"])
    Path(note).write_text(str(child.pid))
    child.wait()


def count_calls(note):
    """Note each call in a file."""
    with open(note, "ab") as file:
        file.write(b"x")


@dataclass(frozen=True)
class Shouting:
    """An argument of a class of its own."""

    text: str


def shout(words):
    """Return what an argument holds."""
    return words.text.upper()


def is_compiled(folder):
    """Return whether `compile_slowly` has compiled."""
    return Path(folder, "compiled").exists()


def compile_slowly(folder):
    """Compile, if that is not done, as long as there is no file ``go``; note which of the two it was."""
    compiles = not is_compiled(folder)
    with Path(folder, "calls").open("a") as file:
        file.write("c" if compiles else "l")
    if compiles:
        hold(folder)
        Path(folder, "compiled").touch()


def is_killed():
    """Be killed, as by a machine without memory."""
    os.kill(os.getpid(), signal.SIGKILL)


def compile_and_die(folder):
    """End the process the first time, as a machine without memory does; compile the next time."""
    if not Path(folder, "calls").exists():
        Path(folder, "calls").write_text("c")
        os.kill(os.getpid(), signal.SIGKILL)
    compile_slowly(folder)
