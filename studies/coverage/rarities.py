"""Shares of a few ppm from importance sampling, well aimed and badly aimed."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from campaign.inputs.sampling.importance import Component, Proposal, aimed, drawn_from, log_weights, moved
from reporting import Design
from reporting.rare.rare_rejects import rare_rejects
from reporting.spec import ProposalPart
from studies.coverage.outcomes import Statement
from studies.coverage.productions import CONFIDENCE, SHARES, VARIABLES, Production, request, samples_of, truth

# Limits as scores: 0.48 ppm below, 1.0 ppm above.
FAR = (-4.9, 4.75)
# Scores of the response around which each campaign draws.
AIMS = {"aimed well": (-4.9, 4.75), "aimed too near": (-3.5, 3.5), "aimed at one limit": (4.75,), "aimed nowhere": ()}
AIMED = tuple(Production(name, "normal") for name in AIMS)
_WEIGHTS = dict(zip(VARIABLES, np.sqrt(SHARES).tolist(), strict=True))


def rare_shares(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of the shares beyond each limit and beyond either."""
    true = truth("normal", limits=FAR)
    proposal = _proposal(AIMS[production.name])
    component = drawn_from(proposal, rng.random(n))
    scores = moved(proposal, component, {name: rng.standard_normal(n) for name in VARIABLES})
    x = np.column_stack(list(scores.values()))
    samples = replace(
        samples_of(production, production.values(x), x),
        importance={
            "component": component.astype(np.float64),
            "log_weight": log_weights(proposal, scores),
            "aimed": aimed(proposal, scores).astype(np.float64),
        },
    )
    spec = replace(
        request(production, n, true),
        sampler="importance",
        design=Design(True, "weighted"),
        proposal=tuple(
            ProposalPart(c.share, c.scale, tuple((v, z) for v, z in c.shift.items() if z), "")
            for c in proposal.components
        ),
    )
    found = rare_rejects(samples, spec, CONFIDENCE)
    assert found is not None
    (response,) = found.responses
    for side, share, ppm in (
        ("below", response.below, 1e6 * float(norm.cdf(FAR[0]))),
        ("above", response.above, 1e6 * float(norm.sf(FAR[1]))),
        ("total", response.total, true.ppm),
    ):
        yield Statement(f"rare, {side}", None if share is None else share.interval, ppm)


def _proposal(centres: tuple[float, ...]) -> Proposal:
    """Return a proposal with a component around each of the given scores of the response, and a wide component."""
    components = [
        Component(share=0.7 / len(centres), shift={name: a * centre for name, a in _WEIGHTS.items()})
        for centre in centres
    ]
    return Proposal(components=(*components, Component(share=0.2, scale=2.0)))
