"""Thousands of odd arrays and numbers against every public function that takes some: results, or the project's errors.

The seed is the same in each run, and stands in the failure's message; `CLEARCAP_SECURITY_SEED` gives another one.
"""

import datetime
import decimal
import fractions
import os
import traceback
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

import engine
import engine.friction
import engine.mechanism
import reporting
from engine import EngineError
from engine.friction.indeterminacy import normal_force_range
from reporting import ReportError
from reporting.capability.shares import runs_to_claim
from reporting.gauge import gauge_bias, gauge_repeatability
from tests.each import each
from tests.engine.friction.problems import random_problem

SEED = int(os.environ.get("CLEARCAP_SECURITY_SEED") or 1)
TRIES = 300  # of each function
MORE_TRIES = 2000
OURS = (EngineError, ReportError)
EDGES = (0.0, -0.0, 5e-324, -5e-324, 2.2e-308, 1e-300, 1e-160, 1e160, 1.7e308, -1.7e308, np.inf, -np.inf, np.nan, 1, -1)
SIZES = (0, 1, 2, 3, 5, 6, 7, 12, 18, 36)


class Target(NamedTuple):
    """A public function, arguments that it accepts, and those of them that are replaced."""

    call: Callable[..., Any]
    sound: dict[str, Any]
    replaced: tuple[str, ...]


def odd_number(rng: np.random.Generator) -> Any:
    """Return something that stands where a number should."""
    kinds = [
        lambda: EDGES[rng.integers(len(EDGES))],
        lambda: np.float64(EDGES[rng.integers(len(EDGES))]),
        lambda: np.float32(rng.normal()),
        lambda: np.longdouble("1e4000"),
        lambda: int(rng.integers(-5, 5)),
        lambda: 10**400,
        lambda: bool(rng.integers(2)),
        lambda: str(rng.normal()),
        lambda: b"1",
        lambda: 1j,
        lambda: None,
        lambda: decimal.Decimal("NaN"),
        lambda: fractions.Fraction(1, 3),
        lambda: np.array(1.0),
        lambda: np.array([1.0]),
        lambda: np.ma.masked,
        lambda: np.datetime64("NaT", "s"),
        lambda: datetime.date(2020, 1, 1),
        lambda: object(),
        lambda: [],
        lambda: {},
    ]
    return kinds[rng.integers(len(kinds))]()


def odd_array(rng: np.random.Generator, like: Any) -> Any:
    """Return something that stands where an array should: of the right shape and odd numbers, or of another shape."""
    sound = np.asarray(like, float)
    shape = sound.shape if rng.random() < 0.6 else tuple(rng.choice(SIZES, rng.integers(0, 4)))
    if int(np.prod(shape)) > 5000:
        shape = shape[:1]
    values = sound.copy() if shape == sound.shape else rng.standard_normal(shape)
    values = np.array(values * 10.0 ** (rng.integers(-30, 30) if rng.random() < 0.2 else 0))
    if values.size and rng.random() < 0.5:
        flat = values.reshape(-1)
        flat[rng.integers(flat.size, size=rng.integers(1, 4))] = EDGES[rng.integers(len(EDGES))]
    if values.size and rng.random() < 0.1:
        values[...] = EDGES[rng.integers(len(EDGES))]
    read_only = np.array(values)
    read_only.flags.writeable = False
    kinds = [
        lambda: values,
        lambda: values,
        lambda: values,
        lambda: read_only,
        lambda: np.repeat(values, 2, axis=-1)[..., ::2] if values.ndim else values,
        lambda: np.asfortranarray(values),
        lambda: values[::-1] if values.ndim else values,
        lambda: values.tolist(),
        lambda: np.ma.masked_array(values, rng.random(values.shape) < 0.3),
        lambda: values.astype(object),
        lambda: values.astype(str),
        lambda: values.astype(complex),
        lambda: np.zeros(values.shape, bool),
        lambda: np.zeros(values.shape, np.int8),
        lambda: np.zeros(values.shape, "M8[s]"),
        lambda: np.zeros(values.shape, [("a", "f8"), ("b", "i4")]),
        lambda: np.broadcast_to(1.0, values.shape),
        lambda: values.astype(np.longdouble),
        lambda: values.astype(">f8"),
        lambda: [[1.0], [1.0, 2.0]],
        lambda: [None] * (values.size or 1),
        lambda: [10**400] * (values.size or 1),
        lambda: (number for number in (1.0, 2.0)),
        lambda: {1.0, 2.0},
        lambda: {"a": 1.0},
        lambda: "values",
        lambda: odd_number(rng),
    ]
    with np.errstate(all="ignore"):
        return kinds[rng.integers(len(kinds))]()


def solve_problem(M: Any, H: Any, q: Any, mu: Any, start: Any, tolerance: Any) -> None:
    """Make a friction problem and solve it; whatever is called solved keeps its contacts from closing."""
    problem = engine.friction.FrictionProblem(M, H, q, mu)
    solution = engine.friction.solve(problem, tolerance, start)
    assert solution.status in ("converged", "not_converged", "infeasible")
    if solution.converged and tolerance <= 1e-8:
        largest = max(np.abs(problem.q).max(initial=0), np.abs(solution.u).max(initial=0))
        with np.errstate(over="ignore"):
            bound = 2e-6 * problem.mu.size * np.hypot(1, problem.mu.max(initial=0)) * largest
        assert solution.u[::3].min(initial=0) >= -bound
    if solution.status == "infeasible":
        assert (solution.certificate >= 0).all()


def targets() -> dict[str, Target]:
    """Return the functions; a test below checks that no public one that takes arrays or numbers is left out."""
    rng = np.random.default_rng(0)
    problem = random_problem(0, 4, bodies=2)
    solution = engine.friction.solve(problem)
    parts = {name: getattr(problem, name) for name in ("M", "H", "q", "mu")}
    mechanism = engine.load_mechanism("incline")
    limits = {"lsl": -3.0, "usl": 3.0, "target": 0.1, "confidence": 0.95}
    values = {"x": rng.normal(size=36), "batches": np.repeat(np.arange(6), 6), **limits}
    of_gauge = {"values": rng.normal(size=36), "confidence": 0.95}
    run = {"mechanism": mechanism, "values": {"bodies.block.mass": 1.5}, "step": 1e-2, "horizon": 2e-2}
    range_of = {"H": problem.H, "mu": problem.mu, "r": solution.r, "contact": 1}
    return {
        "solve": Target(
            solve_problem, {**parts, "start": solution.r, "tolerance": 1e-8}, (*parts, "start", "tolerance")
        ),
        "normal_force_range": Target(normal_force_range, range_of, tuple(range_of)),
        "capability": Target(reporting.capability, values, tuple(values)),
        "gauge_repeatability": Target(
            gauge_repeatability,
            {**of_gauge, "parts": np.tile(np.arange(6), 6), "operators": np.repeat(np.arange(3), 12), "tolerance": 6.0},
            (*of_gauge, "parts", "operators", "tolerance"),
        ),
        "gauge_bias": Target(
            gauge_bias, {**of_gauge, "references": np.tile(np.arange(3.0), 12)}, (*of_gauge, "references")
        ),
        "runs_to_claim": Target(runs_to_claim, {"ppm": 64.0, "confidence": 0.95, "rejects": 2}, ("ppm", "confidence")),
        "simulate": Target(engine.simulate, run, ("step", "horizon")),
        "set_values": Target(_set, {"mechanism": mechanism, "number": 0.3}, ("number",)),
        "mechanism_from": Target(_describe, {"number": 0.3}, ("number",)),
        "Recording": Target(_record, {"every": 2}, ("every",)),
    }


def _set(mechanism: Any, number: Any) -> None:
    """Set a number of a mechanism."""
    engine.set_values(mechanism, {"materials.block_slope.friction": number})
    engine.check(mechanism, {"bodies.block.mass": number})


def _describe(number: Any) -> None:
    """Make a mechanism from a description with a number replaced."""
    data = {
        "format": 1,
        "name": "odd",
        "units": "SI",
        "simulation": {"step": number, "horizon": 1.0, "penetration": 1e-6},
    }
    engine.mechanism.mechanism_from(
        {**data, "gravity": number, "bodies": {"a": {"mass": number, "inertia": number}}}, "odd"
    )


def _record(every: Any) -> None:
    """Take a recording as `simulate` does; the file itself is not written."""
    engine.Recording.of(engine.Recording("motion.h5", every))


def attack(target: Target, tries: int, seed: int, name: str) -> None:
    """Replace one or two arguments by odd ones, again and again; the first exception that is not ours fails."""
    rng = np.random.default_rng([seed, len(name), *name.encode()])
    for k in range(tries):
        given = dict(target.sound)
        for key in rng.choice(target.replaced, min(len(target.replaced), int(rng.integers(1, 3))), replace=False):
            sound = target.sound[key]
            given[key] = odd_array(rng, sound) if np.ndim(sound) or rng.random() < 0.2 else odd_number(rng)
        try:
            target.call(**given)
        except OURS as error:
            assert str(error), f"{name}: an error without a message"  # noqa: PT017
        except Exception:
            shown = {key: value for key, value in given.items() if value is not target.sound[key]}
            pytest.fail(
                f"CLEARCAP_SECURITY_SEED={seed}, {name}, try {k}, {str(shown)[:1500]}\n{traceback.format_exc()[-3000:]}"
            )


NAMES = (
    "solve",
    "normal_force_range",
    "capability",
    "gauge_repeatability",
    "gauge_bias",
    "runs_to_claim",
    "simulate",
    "set_values",
    "mechanism_from",
    "Recording",
)


@each("name", NAMES)
def test_odd_arguments_give_results_or_our_errors(name):
    """Wrong shapes, types, sizes, masks, orders, infinite, tiny, huge numbers."""
    slow_ones = ("simulate", "Recording", "set_values", "mechanism_from")
    attack(targets()[name], TRIES // 4 if name in slow_ones else TRIES, SEED, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["solve", "normal_force_range", "capability"])
def test_many_more_odd_arguments(name):
    """As above, where most of the arithmetic is."""
    attack(targets()[name], MORE_TRIES, SEED + 1, name)


@each(
    ("lsl", "usl", "text"),
    [
        (0.0, 5e-324, "too close to"),
        (-1.7e308, 1.7e308, "too far from"),
        (1.0, 1.0, "not below"),
        (2.0, 1.0, "not below"),
        (np.nan, 1.0, "finite"),
        (-np.inf, 1.0, "finite"),
        (10**400, None, "finite"),
        ("1", 2.0, "must be a number"),
        (np.array([1, 2]), 2.0, "must be a number"),
    ],
)
def test_limits_that_are_none(lsl, usl, text):
    """Limits a denormal number from each other raised ZeroDivisionError."""
    with pytest.raises(ReportError, match=text):
        reporting.capability([0.0, 1.0, 2.0], lsl, usl)


@each("spread", [0.0, 5e-324, 1e-310, 1e-200, 1e200])
@each("limit", [0.0, 1e-320, 1.0])
def test_values_without_a_spread_worth_the_name(spread, limit):
    """Constant values on a limit, and sigmas too small or too large for squares, give numbers or None."""
    numbers = reporting.capability([limit, limit + spread, limit - spread, limit], lsl=limit, usl=limit + 1, target=0.5)
    for value in vars(numbers).values():
        assert not isinstance(value, float) or np.isfinite(value)


@pytest.mark.parametrize(
    "start",
    [[1.0], np.zeros((3, 3)), ["a"] * 12, [np.nan] * 12, [None] * 12, np.ma.masked_array(np.ones(12), True), 1j],
)
def test_a_start_that_does_not_fit_is_named(start):
    """It was NumPy's error."""
    with pytest.raises(engine.friction.FrictionError, match="start"):
        engine.friction.solve(random_problem(0, 4), start=start)


def test_every_public_name_that_takes_arrays_or_numbers_is_attacked():
    """A new public name must be attacked, or listed here with those that take neither."""
    neither = {
        *(
            "CadError",
            "Certificate",
            "EngineError",
            "Fault",
            "FolderError",
            "Mechanism",
            "MechanismError",
            "NotAssemblable",
            "TextPosition",
            "Run",
            "Trajectory",
            "TrajectoryError",
        ),
        *("build_id", "check", "library_names", "load_mechanism", "load_mechanism_text", "position_of"),
        *("read_trajectory", "warm_up"),
        *("FrictionError", "FrictionProblem", "FrictionSolution", "read_fclib", "read_fclib_impulses", "write_fclib"),
        *("full_key", "get_value", "mechanism_schema", "missing_kernels", "settable_keys", "settable_numbers"),
        *("SettableNumber", "unit_of"),
        *(
            "Assumption",
            "Capability",
            "Design",
            "ReportError",
            "ReportSpec",
            "ResponseSpec",
            "VariableSpec",
            "write_report",
        ),
    }
    public = {*engine.__all__, *engine.friction.__all__, *engine.mechanism.__all__, *reporting.__all__}
    assert public - neither <= set(NAMES)
    assert set(targets()) == set(NAMES)
