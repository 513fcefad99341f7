"""What holds for all tests."""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell: tests send interrupts
    signal.signal(signal.SIGINT, signal.default_int_handler)
# What tests start imports them too. It does not look into its current folder: clearcap forbids that to all it starts.
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(TESTS.parent), os.environ.get("PYTHONPATH"))))
# These files take longest. They start first, so that all processes end at about the same time.
LONGEST = (
    "campaign/storms/test_storms.py",
    "system/test_c60.py",  # compiles the engine once for all, while another process tests the reports
    "reporting",
    "campaign/web/journeys",
    "campaign/storms/test_failures.py",
    "test_sessions.py",
    "studies/coverage/test_documented.py",
    "engine/profile/test_step_times.py",
    "campaign/storms/test_same_bits.py",
    "security/test_s3_faults.py",
    "security/test_mutated_files.py",
    "campaign/store/files/test_s3.py",
    "campaign/storms/test_service.py",
    "deploy/test_slurm.py",
    "deploy/test_hosts.py",
    "campaign/cli/test_verbs.py",
    "campaign/coordinator/test_coordinator.py",
    "campaign/worker/test_subprocess_runs.py",
)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Look for no garbage while tests are collected, nor ever after in what was: that took two fifths of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files that take longest first."""
    items.sort(key=lambda item: _position(item.path.relative_to(TESTS).as_posix()))


def _position(path: str) -> int:
    """Return the place of a file in `LONGEST`, or behind all of them."""
    return next((place for place, longest in enumerate(LONGEST) if path.startswith(longest)), len(LONGEST))


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """In CI a skipped test is a failure: there everything a test needs is installed."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("CI") and exitstatus == 0 and reporter is not None and reporter.stats.get("skipped"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
