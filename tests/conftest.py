"""What holds for all tests: no clock but one that only a hang reaches, no chance but one that can be repeated.

``CLEARCAP_RERUNS`` is how often a failed test that starts processes is run again (`.ci/run`: once); it is then named as
flaky. ``CLEARCAP_FRESH`` has hypothesis look for new examples (`make full`).
"""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests.bounded import pytest_runtest_call as pytest_runtest_call
from tests.bounded import pytest_runtest_setup as pytest_runtest_setup
from tests.bounded import pytest_runtest_teardown as pytest_runtest_teardown

TESTS = Path(__file__).parent
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell: tests send interrupts
    signal.signal(signal.SIGINT, signal.default_int_handler)
# What tests start imports them too. It does not look into its current folder: clearcap forbids that to all it starts.
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(TESTS.parent), os.environ.get("PYTHONPATH"))))
# An example is refused for being wrong, never for being slow: the first call of a test pays for imports.
_SLOW_IS_FINE = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("same", derandomize=True, **_SLOW_IS_FINE)
settings.register_profile("fresh", print_blob=True, **_SLOW_IS_FINE)
settings.load_profile("fresh" if os.environ.get("CLEARCAP_FRESH") else "same")
# These files take longest. They start first, so that all processes end at about the same time.
LONGEST = (
    "campaign/storms/test_storms.py",
    "system/test_c60.py",  # compiles the engine once for all, while another process tests the reports
    "reporting",
    "clearcap/web/journeys",
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
    "clearcap/cli/test_verbs.py",
    "campaign/coordinator/test_coordinate.py",
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
    """Put the files that take longest first; have tests of processes run again where that is asked for."""
    items.sort(key=lambda item: _position(os.path.relpath(item.path, TESTS)))
    if reruns := int(os.environ.get("CLEARCAP_RERUNS") or 0):
        for item in items:
            if item.get_closest_marker("processes"):
                item.add_marker(pytest.mark.flaky(reruns=reruns))


def _position(path: str) -> int:
    """Return the place of a file in `LONGEST`, or behind all of them."""
    return next((place for place, longest in enumerate(LONGEST) if path.startswith(longest)), len(LONGEST))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name the tests that failed and passed when they were run again: each is a fault of the test or of the product."""
    passed = {report.nodeid for report in terminalreporter.getreports("passed")}
    flaky = {report.nodeid for report in terminalreporter.getreports("rerun")} & passed
    if flaky:
        terminalreporter.section("flaky: failed, and passed when run again")
        for name in sorted(flaky):
            terminalreporter.write_line(name)


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """In CI a skipped test is a failure: there everything a test needs is installed."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("CI") and exitstatus == 0 and reporter is not None and reporter.stats.get("skipped"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
