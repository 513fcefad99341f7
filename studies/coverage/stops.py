"""The interval at which a stopping rule ends a campaign: its coverage although the rule chose the moment."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pyarrow as pa

from campaign.coordinator.stopping_rule import judge
from campaign.plan import Plan
from campaign.spec.campaign_file import CampaignSpec
from campaign.store import Store
from engine.arrays import Array
from studies.coverage.outcomes import Statement
from studies.coverage.productions import CONFIDENCE, RESPONSE, Production, Truth, truth

# Half widths: of Cpk, and of mean and sigma in sigmas.
HALF_WIDTHS = {"cpk": 0.1, "mean": 0.1, "std": 0.1}


class _Unitless:
    """Stand-in for a mechanism, for a stopping rule: its response is not a length, angle, force or torque."""

    simulation = None

    def response_units(self) -> dict[str, str]:
        """Return the unit of each response."""
        return {RESPONSE: "1"}

    def unit(self, quantity: str) -> str:
        """Return the unit of a quantity."""
        return quantity


@dataclass(frozen=True)
class _Planned:
    """Stand-in for a plan, for a stopping rule."""

    spec: CampaignSpec
    mechanism: "_Unitless"


@dataclass(frozen=True)
class _Rows:
    """Stand-in for the rows of a store, for a stopping rule."""

    values: Array

    def stream(self, plan: object, columns: Sequence[str], *_: object, **__: object) -> Iterator[pa.Table]:
        """Yield all rows as one table."""
        table = pa.table({"sample": np.arange(self.values.size), RESPONSE: self.values})
        yield table.select(list(columns))


def stops(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the interval at the end of a campaign with a stopping rule, after n samples at the latest."""
    true = truth(production.shape)
    rows = _Rows(production.draw(n, rng))
    for statistic, value in (("cpk", true.cpk), ("mean", true.mean), ("std", true.std)):
        planned = _Planned(_spec(production, n, true, statistic), _Unitless())
        rule = planned.spec.stop
        assert rule is not None
        for samples in rule.checkpoints(n):
            verdict = judge(cast(Store, rows), cast(Plan, planned), samples)
            if verdict.sure:
                break
        at_end = (verdict.low, verdict.high) if verdict.low is not None and verdict.high is not None else None
        yield Statement(f"at the stop: {statistic}", at_end if verdict.sure else None, value)


def _spec(production: Production, n: int, true: Truth, statistic: str) -> CampaignSpec:
    """Return a campaign with a stopping rule on the given statistic."""
    half_width = HALF_WIDTHS[statistic] * (1.0 if statistic == "cpk" else true.std)
    variable: dict[str, Any] = {"distribution": "normal", "mean": 0.0, "std": 1.0}
    if production.lots:
        variable["batch"] = {"size": n // production.lots, "std": production.between}
    rule = {"response": RESPONSE, "statistic": statistic, "half_width": half_width, "confidence": CONFIDENCE}
    return CampaignSpec.model_validate(
        {
            "format": 1,
            "name": "study",
            "mechanism": "c60",
            "samples": n,
            "stop": rule,
            "variables": {"X1": variable},
            "responses": {RESPONSE: {"lsl": true.lsl, "usl": true.usl}},
        }
    )
