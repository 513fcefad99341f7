"""Wait for a condition, not for a duration: the deadline is minutes, which only a hang reaches."""

import time
from collections.abc import Callable
from typing import Any


def until(
    condition: Callable[[], Any], what: str | Callable[[], str] = "", seconds: float = 600.0, pause: float = 0.05
) -> Any:
    """Return the first true result of a condition; say what was waited for if none comes."""
    end = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < end, (what() if callable(what) else what) or f"not so within {seconds:g} s"
        time.sleep(pause)
    return result
