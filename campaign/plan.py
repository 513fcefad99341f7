"""The plan of a campaign: immutable, complete, and identified by a hash of everything its rows depend on."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from campaign.batches import Batches
from campaign.inputs.sampling import sampler_named
from campaign.plan_header import (
    WITHOUT_DIGEST,
    PlanHeader,
    changed_plan,
    parse_plan,
    seal_plan,
    unreadable_plan,
    usual_share,
)
from campaign.row_build import UNKNOWN, row_build
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.load import Campaign
from campaign.spec.result_columns import LATER_COLUMNS, results_schema
from engine import MechanismError, build_id
from engine.mechanism import Mechanism, mechanism_from

BATCH_TIME = 10.0  # s: limits the work that a killed worker loses, and how long a cancelled campaign goes on
LARGEST_BATCH = 10_000  # runs: a worker keeps the rows of its batch in memory until it writes them
UNTRIED_BATCH = 100  # runs, if the time of a run is unknown
LEAST_BATCHES = 40  # makes progress visible and keeps all workers busy until the end


@dataclass(frozen=True)
class Plan(PlanHeader):
    """What to compute: a pure function of the spec, the mechanism and the build of clearcap."""

    spec: CampaignSpec
    mechanism: Mechanism  # complete: workers need no other file
    row_build: str  # the only build whose rows are accepted; see `campaign.row_build`
    engine_build: str  # for the report

    @cached_property
    def targets(self) -> dict[str, str]:
        """Key of the mechanism that each variable sets, by variable name."""
        return self.spec.targets()

    def to_json(self) -> str:
        """Return the content of ``plan.json``."""
        content = {
            "campaign": self.campaign_id,
            "row_build": self.row_build,
            "engine_build": self.engine_build,
            "mechanism_digest": self.mechanism.digest(),
            "spec": dump_spec(self.spec),
            "schema": self.columns,
            **({"batch_size": self.batches.size} if isinstance(self.batches, Batches) else {"batches": self.batches}),
            "repeats": self.repeats,
            "mechanism": json.loads(self.mechanism.model_dump_json(by_alias=True, exclude_none=True)),
        }
        return seal_plan(content)

    @classmethod
    def from_json(cls, text: str) -> "Plan":
        """Read ``plan.json``; raise StoreError if the file has another format, or was changed after it was written."""
        header, document = parse_plan(text)
        try:
            spec = CampaignSpec.model_validate(document["spec"])
            mechanism = mechanism_from(document["mechanism"], "mechanism")
            build, engine = document.get("row_build", UNKNOWN), document["engine_build"]
        except (ValueError, KeyError, TypeError, RecursionError, AttributeError, MechanismError) as error:
            raise unreadable_plan(error) from error
        if document["format"] == WITHOUT_DIGEST:
            campaign_id = _identity(spec, mechanism, {"engine": engine})
            columns = [c for c in _columns(spec, mechanism, campaign_id) if c["name"] not in LATER_COLUMNS]
            if campaign_id != header.campaign_id or columns != header.columns:
                raise changed_plan()
        content = (header.campaign_id, header.title, header.batches, header.columns, spec, mechanism, build, engine)
        return cls(*content, repeats=header.repeats, judges_unfit=header.judges_unfit)


def make_plan(campaign: Campaign, batch_size: int | None = None, seconds_per_run: float | None = None) -> Plan:
    """Plan a campaign for this build of clearcap; rows do not depend on the batch size."""
    # Without one a batch takes a worker about ten seconds by ``seconds_per_run``, with at least 40 batches of at most
    # 10,000 samples each, or of at most 100 if that time is not given either.
    spec, mechanism, build = campaign.spec, campaign.mechanism, row_build()
    batches = Batches(spec.samples, min(batch_size or _size(spec.samples, seconds_per_run), spec.samples))
    campaign_id = _identity(spec, mechanism, {"build": build})
    columns = _columns(spec, mechanism, campaign_id)
    content = (campaign_id, spec.title or spec.name, batches, columns, spec, mechanism, build, build_id())
    judged = spec.failures.max_not_assemblable is not None
    return Plan(*content, repeats=_repeated_share(spec), judges_unfit=judged)


def batch_size_is_fixed(samples: int) -> bool:
    """Return whether a campaign has so few samples that its batch size does not depend on the run time."""
    return samples < 2 * LEAST_BATCHES


def _size(samples: int, seconds: float | None) -> int:
    most = UNTRIED_BATCH if seconds is None else min(BATCH_TIME / max(seconds, 1e-6), LARGEST_BATCH)
    return max(int(min(most, samples // LEAST_BATCHES)), 1)


def _repeated_share(spec: CampaignSpec) -> float:
    """Return the share of its samples that a campaign repeats with half the step."""
    if spec.repeats is not None:
        return spec.repeats.share
    has_weights = "log_weight" in sampler_named(spec.sampler).columns  # most of its runs do not represent production
    return 0.0 if has_weights else usual_share(spec.samples)


def dump_spec(spec: CampaignSpec) -> dict[str, Any]:
    """Return a spec as the plain tables of a campaign file, without what is not set."""
    return spec.model_dump(mode="json", exclude_none=True)


def _columns(spec: CampaignSpec, mechanism: Mechanism, campaign_id: str) -> list[dict[str, Any]]:
    return [
        {
            "name": field.name,
            "type": str(field.type),
            "unit": (field.metadata or {}).get(b"unit", b"").decode(),
            "nullable": field.nullable,
        }
        for field in results_schema(mechanism, spec.targets(), campaign_id, sampler_named(spec.sampler).columns)
    ]


def _identity(spec: CampaignSpec, mechanism: Mechanism, build: Mapping[str, str]) -> str:
    """Return the id of a campaign: its name and a hash of everything its rows depend on."""
    content: dict[str, Any] = {"spec": dump_spec(spec), "mechanism": mechanism.digest(), **build}
    if sampler_named(spec.sampler).ordered:
        content["order"] = list(spec.variables)
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return f"{spec.name}-{hashlib.sha256(canonical.encode()).hexdigest()[:10]}"


# -- values of two runs that differ by less than the resolution of the solver count as equal ---------------------------


def resolution(mechanism: Mechanism, response: str) -> tuple[float, float]:
    """Return the largest insignificant difference of a response, in its unit and as a share of the largest value."""
    # A position is known to within the penetration that a step tolerates, an angle to within that penetration divided
    # by the size of the mechanism, and a force or a torque to within the relative residual of the friction problems.
    unit, sim = mechanism.response_units()[response], mechanism.simulation
    if unit == mechanism.unit("length"):
        return sim.penetration, 0.0
    if unit == mechanism.unit("angle"):
        return sim.penetration / (_extent(mechanism.model_dump()) or 1.0), 0.0
    if unit in (mechanism.unit("force"), mechanism.unit("torque")):
        return 0.0, sim.tolerance
    return 0.0, 0.0


def _extent(part: Any, key: str = "") -> float:
    """Return the largest coordinate of any point in a mechanism, or in a part of it."""
    if isinstance(part, dict):
        return max((_extent(value, name) for name, value in part.items()), default=0.0)
    if isinstance(part, list | tuple):
        is_point = "point" in key and all(isinstance(x, int | float) for x in part)
        return max((abs(x) if is_point else _extent(x, key) for x in part), default=0.0)
    return 0.0
