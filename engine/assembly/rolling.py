"""Companions of the contacts that resist rolling or spinning, named CONTACT~rolling and CONTACT~spinning."""

from collections.abc import Iterator, Sequence

import numpy as np

from engine.assembly.contacts import Pair
from engine.kernels.model import GEOMETRY, ROLLING, SPINNING
from engine.mechanism.models import Mechanism


def rolling_pairs(mechanism: Mechanism, pairs: Sequence[Pair], first: int) -> Iterator[Pair]:
    """Yield the companions of the contacts in [contacts], whose numbers begin with ``first``."""
    nowhere = np.zeros(GEOMETRY)
    for number, pair in enumerate(pairs, first):
        rolling, spinning = mechanism.rolling_friction(mechanism.contacts[pair.name.partition(".")[0]])
        for word, kind, arm in (("rolling", ROLLING, rolling), ("spinning", SPINNING, spinning)):
            if arm:
                name, law = f"{pair.name}~{word}", (1.0, 0.0)
                yield Pair(name, kind, pair.a, pair.b, nowhere, nowhere, 0.0, law, partner=number, arm=arm)
