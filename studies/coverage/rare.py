"""Rare rejects by importance sampling, of limits with a known share: aimed well and badly, and aimed as users do it.

`rare_shares` draws one campaign with components that are given. `designed_shares` draws a plain campaign, then two that
aim by the rows before.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ndtri
from scipy.stats import chi2, norm

from campaign.inputs.sampling.importance import Component, Proposal, aimed, drawn_from, log_weights, moved
from reporting import Design
from reporting.rare.aim import Aim, aims, find_targets
from reporting.rare.rare_rejects import LEAST, Draws, rare_rejects, rare_share
from reporting.spec import ProposalPart
from studies.coverage.outcomes import Statement
from studies.coverage.productions import CONFIDENCE, SHARES, VARIABLES, Production, request, samples_of
from studies.coverage.reliability import PROBLEMS, LimitState, limit_state
from studies.coverage.shapes import truth

PLAIN, FIRST = 2000, 3000  # runs of the plain campaign, and of the first that aims
WRITTEN = 0.999  # of the components' shares: rounding must not take from the plain runs


def flat(dimensions: int, share: float) -> LimitState:
    """Return a limit of a weighted sum."""
    return LimitState(dimensions, share, lambda z: z.sum(axis=1) / np.sqrt(dimensions), -float(ndtri(share)))


def sphere(dimensions: int, share: float) -> LimitState:
    """Return a limit of the distance from the middle: rejects lie in all directions."""
    return LimitState(dimensions, share, lambda z: np.sum(z * z, axis=1), float(chi2.isf(share, dimensions)))


def curved(dimensions: int, curvature: float, share: float) -> LimitState:
    """Return a limit of ``x0 - curvature (x1^2 + ...)``, curved away from the middle if above 0."""
    # The sum of the squares has a chi-square distribution, so the share is one integral.
    k = dimensions - 1

    def beyond(limit: float) -> float:
        ends = 0.0, float(chi2.isf(1e-14, k))
        return float(quad(lambda s: norm.sf(limit + curvature * s) * chi2.pdf(s, k), *ends, points=[k / 4, k])[0])

    limit = brentq(lambda t: beyond(t) - share, -10.0 - 3.0 * abs(curvature) * k, 10.0 + 3.0 * abs(curvature) * k)
    return LimitState(dimensions, share, lambda z: z[:, 0] - curvature * np.sum(z[:, 1:] ** 2, axis=1), float(limit))


STATES = {
    "flat, 7": flat(7, 1e-6),
    "flat, 20": flat(20, 1e-6),
    "sphere, 7": sphere(7, 2e-6),
    "sphere, 20": sphere(20, 2e-6),
    "curved, 3": curved(3, 0.05, 0.03),
    "curved, 7": curved(7, 0.1, 1e-3),
    "curved, 20": curved(20, 0.2, 3e-4),
    "curved, 50": curved(50, 0.1, 3e-4),
}
DESIGNED = tuple(Production(name, "normal") for name in STATES)
LITERATURE = tuple(Production(name, "normal") for name in PROBLEMS)


def designed_shares(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the interval of the last campaign, of n runs; a share of which only a bound is told counts as warned of."""
    state = STATES.get(production.name) or limit_state(production.name)
    names = [f"x{i}" for i in range(state.dimensions)]
    z, weights = rng.standard_normal((PLAIN, state.dimensions)), np.ones(PLAIN)
    for runs in (FIRST, n):
        targets = find_targets(z, weights, {"y": state.response(z)}, {"y": (None, state.limit)})
        proposal = _proposal_of(aims(targets, state.dimensions), names)
        component = drawn_from(proposal, rng.random(runs))
        scores = moved(proposal, component, {name: rng.standard_normal(runs) for name in names})
        z, weights = np.column_stack(list(scores.values())), np.exp(log_weights(proposal, scores))
    unshifted = np.array([True, *(not part.shift for part in proposal.components)])
    by_chance = unshifted[component] & ~aimed(proposal, scores)
    scales = np.array([1.0, *(part.scale for part in proposal.components)])
    drawn = np.bincount(component[by_chance], minlength=scales.size) / n
    spreads = tuple(zip(drawn[unshifted].tolist(), scales[unshifted].tolist(), strict=True))
    draws = Draws(weights, by_chance, unshifted[component], spreads, CONFIDENCE, component == 0)
    found = rare_share(state.response(z) > state.limit, draws)
    bound = bool(found.doubt) or found.rejects < LEAST
    yield Statement("rare, designed", found.interval, 1e6 * state.share, warned=bound)
    yield Statement("rare, bound", found.interval if bound else None, 1e6 * state.share)


def _proposal_of(components: tuple[Aim, ...], names: list[str]) -> Proposal:
    """Return the proposal that a campaign file would have."""
    return Proposal(
        components=tuple(
            Component(
                share=WRITTEN * aim.share,
                scale=aim.scale,
                shift={name: x for name, x in zip(names, aim.centre, strict=True) if x},
            )
            for aim in components
        )
    )


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
