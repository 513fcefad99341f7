"""How often the model class of ISO 22514-2 is named right, for processes of each class.

`python -m studies.time_models` prints the table of studies/time_models.md.
"""

import argparse
from collections import Counter

import numpy as np

from reporting.arrays import Array
from reporting.shape.time_model import TimeModel, time_model
from studies import head

PROCESSES = 1000
CLASSES = ("A1", "A2", "B", "C1", "C2", "C3", "C4", "D")
GROUPS = ((25, 5), (50, 5), (25, 20))  # subgroups, values in each


def values(name: str, groups: int, size: int, rng: np.random.Generator) -> Array:
    """Return values of a process of a class, shape (groups * size,); sigma within a group is 1 on average."""
    x = rng.lognormal(0.0, 0.6, (groups, size)) if name == "A2" else rng.normal(size=(groups, size))
    if name in ("B", "D"):
        x *= np.exp(rng.normal(0.0, 0.6, (groups, 1)))
    if name in ("C1", "C4", "D"):
        x += rng.normal(0.0, 1.0, (groups, 1))
    if name == "C2":
        x += rng.exponential(1.5, (groups, 1))
    if name in ("C3", "C4"):
        x += np.linspace(-2.0, 2.0, groups)[:, None]
    return np.asarray(x.ravel())


def models(name: str, groups: int, size: int, processes: int) -> list[TimeModel]:
    """Return what is said of processes of a class."""
    rng, of_each = np.random.default_rng((groups, size, CLASSES.index(name))), np.repeat(np.arange(groups), size)
    return [time_model(values(name, groups, size, rng), of_each, "subgroups") for _ in range(processes)]


def held(name: str, found: list[TimeModel]) -> int:
    """Return how often the class is named, or not excluded."""
    return sum(name in (each.name, *each.possible) for each in found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="share of the processes; default: 1")
    processes = max(20, round(parser.parse_args().share * PROCESSES))
    print(head("class", *(f"{groups} subgroups of {size}" for groups, size in GROUPS)))
    for name in CLASSES:
        cells = []
        for groups, size in GROUPS:
            found = models(name, groups, size, processes)
            named = Counter(each.name for each in found)
            others = ", ".join(
                f"{other} {100 * n / processes:.0f}"
                for other, n in named.most_common()
                if other != name and 200 * n >= processes
            )
            right, possible = 100 * named[name] / processes, 100 * held(name, found) / processes
            cells.append(f"{right:.0f} / {possible:.0f}{f' ({others})' if others else ''}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
