"""The first table of studies/row_order.md, against a small part of the study that made it."""

import re

import pytest

from reporting.capability.intervals import share_interval
from studies.row_order import PROCESSES, SIZES, alarms
from tests.each import each
from tests.house import ROOT

pytestmark = pytest.mark.slow

DRAWS = 300
# So far from the whole by chance in one of 10,000 numbers; and a printed percent is rounded.
CHANCE, ROUNDED = 1e-4, 0.005


def documented() -> dict[str, list[float]]:
    """Return the shares of the document by process."""
    section = (ROOT / "studies" / "row_order.md").read_text("utf-8")
    table = section.split("How often the 95 %")[0]
    rows = re.findall(r"^\| (?!process|---)(.+?) \| (.+) \|$", table, re.M)
    return {name: [float(cell.removesuffix(" %")) / 100 for cell in cells.split(" | ")] for name, cells in rows}


def test_the_document_has_every_process():
    assert list(documented()) == [process.name for process in PROCESSES]


@each("process", PROCESSES)
def test_the_document_agrees_with_the_study(process):
    for n, share in zip(SIZES, documented()[process.name], strict=True):
        low, high = share_interval(round(alarms(process, n, DRAWS) * DRAWS), DRAWS, 1 - CHANCE)
        assert low - ROUNDED <= share <= high + ROUNDED, n
