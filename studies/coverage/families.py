"""The estimates that the study repeats, their productions and numbers of replications, and the tallies of all."""

import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from studies.coverage.estimates import contents, counts, indices, methods, products, verdicts, verdicts_in_turn
from studies.coverage.limit_states import DESIGNED, designed_shares
from studies.coverage.outcomes import Statement, Tally, tallied
from studies.coverage.productions import JUDGED_SHAPES, JUMPS, LOTS, LOTS_IN_TURN, SHAPES, SIZES, Production
from studies.coverage.questions import advice, attributions, causes, changes, differences
from studies.coverage.rarities import AIMED, rare_shares
from studies.coverage.stops import stops

SEED = 95
Estimate = Callable[[Production, int, np.random.Generator], Iterator[Statement]]
Key = tuple[str, str, int]  # of a tally: number, production, size


@dataclass(frozen=True)
class Case:
    """Replications of one estimate for one production and size."""

    estimate: Estimate
    production: Production
    n: int  # number of samples
    replications: int

    def tallies(self) -> dict[Key, Tally]:
        """Draw and judge all replications; replication r does not depend on their number."""
        name = f"{self.estimate.__name__} of {self.production.name}, {self.n}"
        # Not `hash`, which differs between processes: a case has the same draws wherever it is computed.
        seed = (SEED, zlib.crc32(name.encode()))
        found = tallied(
            self.estimate(self.production, self.n, np.random.default_rng((*seed, r))) for r in range(self.replications)
        )
        return {(number, self.production.name, self.n): tally for number, tally in found.items()}


# Replications in the complete study, for each production and size.
REPLICATIONS: dict[Estimate, int] = {
    indices: 500,
    counts: 500,
    methods: 60,
    causes: 60,
    changes: 150,
    advice: 60,
    differences: 150,
    products: 300,
    contents: 300,
}
# Estimates for some productions only.
OF_JUMPS, OF_REJECTS, OF_RARE, OF_DESIGNED, OF_STOPS, OF_VERDICTS = 60, 60, 200, 40, 100, 40
LAST = 3200  # values at which a verdict in turn ends


def cases(share: float = 1.0) -> list[Case]:
    """Return all cases with this share of their replications, the longest first."""
    found = [
        Case(estimate, production, n, round(share * replications))
        for estimate, replications in REPLICATIONS.items()
        for production in (*SHAPES, *LOTS)
        for n in SIZES
    ]
    found += [Case(causes, p, n, round(share * OF_JUMPS)) for p in JUMPS for n in SIZES[1:]]
    found += [Case(attributions, p, n, round(share * OF_REJECTS)) for p in (SHAPES[0], *LOTS) for n in SIZES[1:]]
    found += [Case(verdicts, p, n, round(share * OF_VERDICTS)) for p in (*SHAPES, *JUDGED_SHAPES, *LOTS) for n in SIZES]
    judged_in_turn = (SHAPES[0], *JUDGED_SHAPES)
    found += [Case(verdicts_in_turn, p, LAST, round(share * OF_VERDICTS)) for p in judged_in_turn]
    found += [Case(rare_shares, p, n, round(share * OF_RARE)) for p in AIMED for n in SIZES[1:]]
    found += [Case(designed_shares, p, max(SIZES), round(share * OF_DESIGNED)) for p in DESIGNED]
    found += [Case(stops, production, max(SIZES), round(share * OF_STOPS)) for production in LOTS_IN_TURN]
    # So that no process is left with a long case when the others have finished.
    return sorted(found, key=lambda case: -case.n * case.replications)


def all_tallies(chosen: list[Case], mapped: Callable[..., Iterable[dict[Key, Tally]]] = map) -> dict[Key, Tally]:
    """Return the tallies of some cases; ``mapped`` is `map` or a parallel substitute."""
    found: dict[Key, Tally] = {}
    for tallies in mapped(Case.tallies, chosen):
        found |= tallies
    return found
