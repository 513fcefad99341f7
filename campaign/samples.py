"""Samples of a campaign as columns, for questions that need no new runs."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from campaign.errors import CampaignError, FailedStatus
from campaign.inputs.distributions import Continuous
from campaign.inputs.sampling import sampler_named
from campaign.plan import Plan
from campaign.spec.campaign_file import Response
from campaign.store import Store
from engine.arrays import Array
from reporting.arrays import GrowingColumn
from reporting.samples import whole_lots

if TYPE_CHECKING:
    import pyarrow as pa

Limits = dict[str, tuple[float | None, float | None]]


@dataclass(frozen=True)
class SampleColumns:
    """Independently drawn samples as columns."""

    number: NDArray[np.int64]  # of the sample, (n,)
    values: dict[str, Array]  # variables and responses by name, each (n,); NaN if a run has no value

    def first(self, count: int) -> "SampleColumns":
        """Return at most the first ``count`` samples, without a copy."""
        return SampleColumns(self.number[:count], {name: column[:count] for name, column in self.values.items()})


def independent_samples(store: Store, plan: Plan) -> SampleColumns:
    """Return variables and responses of all independently drawn samples; raise CampaignError if there are no rows."""
    columns = samples_in(plan, store.stream(plan, columns_read(plan)))
    if not columns.number.size:
        raise no_samples(plan)
    return columns


def samples_in(plan: Plan, tables: "Iterable[pa.Table]") -> SampleColumns:
    """Return the independent samples in tables of `columns_read`, without those not assemblable that a limit judges."""
    most = sum(count for _, count in plan.batches)
    pieces = {name: GrowingColumn(np.float64, most) for name in column_names(plan)}
    samples = GrowingColumn(np.int64, most)
    for table in tables:
        numbers = table["sample"].to_numpy()
        rows = sampler_named(plan.spec.sampler).independent(plan.spec, numbers)
        if plan.judges_unfit:
            rows = rows & (table["status"].to_numpy(zero_copy_only=False) != FailedStatus.NOT_ASSEMBLABLE)
        chosen = slice(None) if rows.all() else rows  # usually all rows, which need no copy
        samples.add(numbers[chosen])
        for name, column in pieces.items():
            column.add(table[name].to_numpy()[chosen])
    return SampleColumns(samples.array, {name: column.array for name, column in pieces.items()})


def no_samples(plan: Plan) -> CampaignError:
    """Return the error that a campaign has no rows yet."""
    return CampaignError(f"{plan.campaign_id}: no sample is computed yet; wait for the first, or run the campaign")


def column_names(plan: Plan) -> list[str]:
    """Return the names of the columns of a sample: variables, then responses."""
    return [*plan.spec.variables, *plan.mechanism.responses]


def columns_read(plan: Plan) -> list[str]:
    """Return the names of the columns that `samples_in` reads."""
    return ["sample", *column_names(plan), *(["status"] if plan.judges_unfit else [])]


def lots_of(plan: Plan, sample: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Return the lot of each sample, with lots that share no shift of any variable; None without lots."""
    sizes = [v.batch.size for v in plan.spec.variables.values() if isinstance(v, Continuous) and v.batch]
    return whole_lots(sample, sizes)


def limits_of(plan: Plan) -> Limits:
    """Return lower and upper limit of every response of the mechanism; None for a missing limit."""
    return {name: plan.spec.responses.get(name, Response()).limits()[:2] for name in plan.mechanism.responses}
