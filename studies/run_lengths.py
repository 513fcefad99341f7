"""How many points a control chart takes until a test marks one: of a stable process by chance, and after a shift.

`python -m studies.run_lengths` prints the table of studies/run_lengths.md on false alarms and detection.
"""

import argparse

import numpy as np

from reporting.capability.row_order import RULES, moving_averages
from studies import head

PROCESSES, POINTS = 20_000, 1_000
SHIFTS = (0.0, 0.5, 1.0, 2.0)  # of the mean, in standard deviations of a point
WESTERN, NELSON = (tuple(name for name in RULES if name.startswith(family)) for family in ("western", "nelson"))
# Tests of each line: of the points, or of moving averages by weight and limits in sigmas.
CHARTS: dict[str, tuple[str, ...] | tuple[float, float]] = {
    "beyond 3 sigma alone": ("nelson 1",),
    "Nelson 1, 2, 3 (usual)": ("nelson 1", "nelson 2", "nelson 3"),
    "Nelson 1 to 8": NELSON,
    "Western Electric 1, 2": WESTERN[:2],
    "Western Electric 1, 3": ("western electric 1", "western electric 3"),
    "Western Electric 1, 4": ("western electric 1", "western electric 4"),
    "Western Electric 1 to 4": WESTERN,
    "EWMA, weight 0.2, 3 sigma (usual)": (0.2, 3.0),
    "EWMA, weight 0.2, 2.962 sigma": (0.2, 2.962),
    "EWMA, weight 0.1, 2.814 sigma": (0.1, 2.814),
}


def run_length(chart: str, shift: float, processes: int) -> float:
    """Return the mean number of points until the first mark, from processes of 1,000 points each."""
    # A run that is not over counts with its points and without a mark: exact where the chance of a mark does not change
    # with time, as it nearly does not.
    rng, length, marks = np.random.default_rng((processes, int(10 * shift))), 0, 0
    for _ in range(0, processes, 1000):
        z, tests = rng.normal(shift, 1.0, (1000, POINTS)), CHARTS[chart]
        if isinstance(tests[0], float):
            scores, wide = moving_averages(z, np.ones(POINTS, np.intp), tests[0])
            # the published run lengths are those of limits that do not widen
            marked = np.abs(scores * wide) > float(tests[1]) * np.sqrt(tests[0] / (2 - tests[0]))
        else:
            marked = np.zeros(z.shape, bool)
            for name in tests:
                marked |= RULES[str(name)].marked(z)
        first = np.where(marked.any(axis=1), marked.argmax(axis=1) + 1, POINTS)
        length, marks = length + int(first.sum()), marks + int(marked.any(axis=1).sum())
    return length / marks


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="share of the processes; default: 1")
    processes = max(1000, round(parser.parse_args().share * PROCESSES))
    print(head("tests", *(f"{shift:g} sigma" if shift else "no shift" for shift in SHIFTS)))
    for chart in CHARTS:
        found = (run_length(chart, shift, processes) for shift in SHIFTS)
        print(f"| {chart} | {' | '.join(f'{length:.3g}' for length in found)} |", flush=True)


if __name__ == "__main__":
    main()
