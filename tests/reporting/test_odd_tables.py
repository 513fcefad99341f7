"""Whatever a table holds, its report is written or refused, in bounded time."""

import subprocess
import sys

import pytest


@pytest.mark.slow
@pytest.mark.parametrize("part", range(4))
def test_random_tables_are_reported_on_or_refused(part: int) -> None:
    words = [sys.executable, "-m", "tests.reporting.odd_tables", str(1000 * part), "40"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout[-4000:]}\n{done.stderr[-3000:]}"
