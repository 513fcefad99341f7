"""A textbook's stack from its drawing's words: worst case, root sum of squares, inertia and Monte Carlo."""

from importlib.resources import files
from math import hypot, sqrt

import numpy as np
import pytest
from scipy import stats

from campaign.inputs.sampling import draw
from campaign.plan import make_plan
from campaign.spec.load import load_campaign_text
from clearcap.questions.report import report_spec
from engine import simulate
from reporting.tolerance.stack_up import linear_stack

LEVER = files("engine.mechanism").joinpath("library", "lever.toml").read_text("utf-8")
# Shigley, Mechanical Engineering Design, example 1-6: a shouldered screw, three cylinders and a nut; the gap is
# w = a - b - c - d = 0.005 +- 0.010, and statistically +- sqrt(3^2 + 1^2 + 5^2 + 1^2) 1e-3 = 0.006.
PARTS = {"a": (1.750, 0.003), "b": (0.750, 0.001), "c": (0.120, 0.005), "d": (0.875, 0.001)}
SIGNS = {"a": 1, "b": -1, "c": -1, "d": -1}
MECHANISM = LEVER.replace("[parameters]\n", "[parameters]\na = 1.75\nb = 0.75\nc = 0.12\nd = 0.875\n") + (
    '\n[responses.gap]\ntype = "formula"\nformula = "a - b - c - d"\n'
)


def stacked(samples, **process):
    """Return the campaign of the four dimensions with a process each, its samples and their stack."""
    lines = [
        f'{name} = {{ target = "parameters.{name}", distribution = "truncated_normal", dimension = "{size} ±{width}",'
        f" cpk = 1.0{process.get(name, '')} }}"
        for name, (size, width) in PARTS.items()
    ]
    text = f'format = 1\nname = "gap"\nmechanism = "screw.toml"\nsamples = {samples}\n[variables]\n' + "\n".join(lines)
    campaign = load_campaign_text(text, {"screw.toml": MECHANISM.encode()})
    drawn = draw(campaign.spec, 0, samples)
    gap = sum(sign * drawn[name] for name, sign in SIGNS.items())
    return campaign, drawn, gap, linear_stack(gap, drawn, report_spec(make_plan(campaign)).variables)


def test_worst_case_and_root_sum_of_squares():
    """Those of the book, from the slopes of the samples; and the samples are as far as these say."""
    campaign, drawn, gap, stack = stacked(20_000)
    assert stack.worst == pytest.approx((-0.005, 0.015), abs=1e-12)
    assert stack.rss == pytest.approx((0.005 - 0.006, 0.005 + 0.006), abs=1e-12)
    assert stack.reliable
    sigma = 0.98658 * 0.002  # of a normal distribution cut at 3 sigma
    assert stack.rss_sigma == pytest.approx(sigma, rel=1e-4)
    assert gap.std() == pytest.approx(sigma, rel=0.02)
    assert gap.mean() == pytest.approx(0.005, abs=5 * sigma / sqrt(20_000))
    assert -0.005 < gap.min() < gap.max() < 0.015
    first = {f"parameters.{name}": float(column[0]) for name, column in drawn.items()}
    assert simulate(campaign.mechanism, first).responses["gap"] == pytest.approx(gap[0], abs=1e-15)


def test_inertia_of_shifted_parts():
    """Parts off their middle by a third of a tolerance shift the gap by the signed sum: I^2 = sigma^2 + shift^2."""
    shifts = {"a": 0.001, "c": -0.0015}
    _, _, gap, stack = stacked(20_000, **{name: f", shift = {shift}" for name, shift in shifts.items()})
    parts = {name: (width - abs(shifts.get(name, 0.0))) / 3 for name, (_, width) in PARTS.items()}
    low, sigma = {}, {}
    for name, spread in parts.items():  # moments of a normal distribution cut at the limits of the drawing
        size, width = PARTS[name]
        middle = size + shifts.get(name, 0.0)
        cut = stats.truncnorm((size - width - middle) / spread, (size + width - middle) / spread, middle, spread)
        low[name], sigma[name] = cut.mean() - size, cut.std()
    shift = sum(SIGNS[name] * off for name, off in low.items())
    assert stack.shift == pytest.approx(shift, abs=1e-9)
    assert stack.inertia == pytest.approx(hypot(shift, *sigma.values()), rel=1e-6)
    assert hypot(gap.std(), gap.mean() - 0.005) == pytest.approx(stack.inertia, rel=0.02)
    assert np.all(np.abs(gap - 0.005) < 0.01)
