"""Studies whose tables are in the documentation; each is run by `python -m studies.NAME`."""

import platform
import time
from collections.abc import Iterable


def head(*titles: str) -> str:
    """Return the two lines of Markdown that a table begins with."""
    return f"| {' | '.join(titles)} |\n|{' --- |' * len(titles)}"


def made_by(began: float, what: str = "") -> str:
    """Return the last line: what computed the tables from `began`, a time of `time.monotonic`, until now."""
    from campaign.row_build import clearcap_version
    from engine.platform.build import build_id

    minutes = (time.monotonic() - began) / 60
    made = f"clearcap {clearcap_version()}, build {build_id()}, Python {platform.python_version()}{what}"
    return f"\n{made}, in {minutes:.1f} minutes."


def show(lines: Iterable[str]) -> None:
    """Print lines as soon as they are computed."""
    for line in lines:
        print(line, flush=True)
