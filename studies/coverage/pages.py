"""One synthetic campaign in the form that the report takes: samples, request, and warnings of the page."""

import numpy as np

from engine.arrays import Array
from reporting import ReportSpec, ResponseSpec, VariableSpec
from reporting.analysis import Analysis, analyse
from reporting.samples import Samples
from reporting.trust.checks import Check
from studies.coverage.productions import VARIABLES, Production, Truth

RESPONSE, BATCH = "y", "production batch"
CONFIDENCE = 0.95


def samples_of(production: Production, y: Array, variables: Array | None = None) -> Samples:
    """Return values as the rows of a campaign, all with status ok."""
    n = y.size
    columns = {} if variables is None else dict(zip(VARIABLES, variables.T, strict=True))
    return Samples(
        sample=np.arange(n),
        status=np.zeros(n, np.int16),
        statuses=("ok",),
        messages={},
        ok=np.ones(n, np.bool_),
        values={RESPONSE: y, **columns},
        max_residual=np.zeros(n),
        max_penetration=np.zeros(n),
        settled=np.ones(n, np.bool_),
        penetration_unit="mm",
        production_batch=production.lot_of(n),
        run_seconds=None,
    )


def request(production: Production, n: int, true: Truth, variables: tuple[str, ...] = ()) -> ReportSpec:
    """Return the request of a campaign of n samples with one response."""
    batch = -(-n // production.lots) if production.lots else 0
    return ReportSpec(
        title=production.name,
        campaign="study",
        header={},
        responses=(ResponseSpec(RESPONSE, "", "1", true.lsl, true.usl, true.target, "study"),),
        variables=tuple(VariableSpec(name, "1", "normal", None, None, 0.0, 1.0, (), batch=batch) for name in variables),
        provenance={},
        requested=n,
        production_batch_column=BATCH if production.lots else "",
    )


def page(production: Production, y: Array, true: Truth) -> Analysis:
    """Return the report's analysis of values."""
    return analyse(samples_of(production, y), request(production, y.size, true))


def warned_of_all(card: tuple[Check, ...]) -> bool:
    """Return whether the trust card says that the samples support no interval."""
    return any(
        (check.name == "Sampling" and check.level != "info")
        or (check.name == "Production lots" and "are needed" in check.text)
        for check in card
    )


def warned_of_normal(card: tuple[Check, ...]) -> bool:
    """Return whether the trust card says that shares of a normal distribution are, or may be, wrong."""
    (shape,) = (check for check in card if check.name == "Shape")
    return shape.level in ("attention", "bad") or "may be off" in shape.text
