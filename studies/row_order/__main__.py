"""The command: `python -m studies.row_order` prints the tables of docs/report.md on the order of rows."""

import argparse
from collections.abc import Iterator

import numpy as np

from reporting.capability.row_order import row_order
from reporting.capability.summary import capability
from studies.row_order.processes import CORRELATED, PROCESSES, STABLE, Process

SIZES = (30, 50, 125, 500)
STABLE_DRAWS, OTHER_DRAWS = 20_000, 2_000
LIMIT = 4.0  # sigmas from the mean, on both sides: Cpk 1.33
HEAD = f"| process | {' | '.join(f'{n} values' for n in SIZES)} |\n|{' --- |' * (1 + len(SIZES))}"


def alarms(process: Process, n: int, draws: int) -> float:
    """Return the share of samples of a process that raise an alarm."""
    rng = np.random.default_rng((n, draws))
    found = (row_order(process.draw(rng, n)) for _ in range(draws))
    return sum(bool(order and order.finding) for order in found) / draws


def coverage(process: Process, n: int, draws: int) -> float:
    """Return how often the 95 % interval of Cpk contains the true value."""
    rng = np.random.default_rng((n, draws))
    intervals = (capability(process.draw(rng, n), -LIMIT, LIMIT, ordered=False).cpk_interval for _ in range(draws))
    return sum(ends is not None and ends[0] <= LIMIT / 3 <= ends[1] for ends in intervals) / draws


def lines(scale: float) -> Iterator[str]:
    """Yield the lines of both tables, with a share of the draws."""
    yield HEAD
    for process in PROCESSES:
        draws = round(scale * (STABLE_DRAWS if process.stable else OTHER_DRAWS))
        decimals = 1 if process.stable else 0
        yield f"| {process.name} | {' | '.join(f'{100 * alarms(process, n, draws):.{decimals}f} %' for n in SIZES)} |"
    yield ""
    yield HEAD
    for process in (STABLE[0], *CORRELATED.values()):
        shown = (f"{100 * coverage(process, n, round(scale * OTHER_DRAWS)):.0f} %" for n in SIZES)
        yield f"| {process.name} | {' | '.join(shown)} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="share of the draws; default: 1")
    for line in lines(parser.parse_args().share):
        print(line, flush=True)


if __name__ == "__main__":
    main()
