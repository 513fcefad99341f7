"""Questions about the samples of a campaign: a list, a stored row, its repetition, its curves and its motion."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from math import inf, isnan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from campaign.errors import FailedStatus, SpecError
from campaign.json_values import json_values
from campaign.plan import Plan
from campaign.row_build import differences
from campaign.samples import SampleColumns, column_names, limits_of
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.worker.row import repeated_sample, stored_row
from engine import Trajectory, read_trajectory
from engine.arrays import Array

SORTS = ("margin", "sample")
OK, FAILED = "ok", "failed"
STATUSES = (OK, FAILED, *FailedStatus)  # "failed" stands for all that are not ok
MOST_DRAWN, MOST_AXES = 400, 16  # samples and columns of a cloud
Ranges = dict[str, tuple[float, float]]  # ends by column, infinite where there is none
ANIMATION_FRAMES = 45  # half the frames of the command line, so that the animation is ready within seconds


class ListedSample(BaseModel):
    """A sample in a list."""

    sample: int
    status: str = Field(examples=["ok"])
    message: str
    variables: dict[str, float]
    responses: dict[str, float | None] = Field(description="Null where the run has no value")
    margin: float | None = Field(
        description="Smallest distance of a response from its limit, in its standard deviations"
    )
    nearest: str | None = Field(description="The response whose limit is nearest")


class SamplePage(BaseModel):
    """Some samples of a campaign."""

    samples: list[ListedSample]
    total: int = Field(description="Samples with this status within the ranges", examples=[12])
    next: int | None = Field(description="Cursor of the next page; null on the last one")


class StoredSample(BaseModel):
    """A sample as stored."""

    campaign: str
    sample: int
    status: str = Field(examples=["ok"])
    message: str
    variables: dict[str, float]
    responses: dict[str, float | None] = Field(description="Null where the run has no value")
    units: dict[str, str] = Field(description="Of variables, responses and the certificate")
    certificate: dict[str, Any] = Field(description="The certificate of the run")


class ReplayedSample(BaseModel):
    """A sample that was computed again."""

    campaign: str
    sample: int
    row: dict[str, Any] = Field(description="What was computed now")
    stored: dict[str, Any] | None = Field(description="What the store has; null if it has no row of this sample")
    same: bool | None = Field(description="Whether both agree, bit for bit; null if the store has no row")
    differences: str = Field(description="How this program differs from the one that computed the campaign")

    def __repr__(self) -> str:
        """Return the sample and whether it agrees in a line; its rows have dozens of columns."""
        same = {True: "same bits", False: "other bits", None: "not stored"}[self.same]
        return f"<Sample {self.sample} of {self.campaign}, {self.row['status']}: {same}>"

    @property
    def is_broken(self) -> bool:
        """Whether the rows differ although the program is the same."""
        return self.same is False and not self.differences


def list_samples(
    store: Store, plan: Plan, sort: str, status: str | None, cursor: int, count: int, ranges: Sequence[str] = ()
) -> SamplePage:
    """Return `count` samples of a campaign after the first `cursor`, of one of `STATUSES` or, for None, of all.

    `sort` is ``margin``, ``sample`` or a column, smallest first, or with ``-`` before it largest first; samples without
    a value come last. The margin is the smallest distance of a response from its limit, in its standard deviations,
    negative outside the limits. For `ranges` see `ranges_of`.
    """
    columns, ends = column_names(plan), ranges_of(plan, ranges)
    order = sort.removeprefix("-")
    if order not in SORTS and order not in columns:
        allowed = ", ".join((*SORTS, *columns))
        raise SpecError(f"sort = {sort!r:.40}; allowed: {allowed}, or - and one of these for the largest first")
    if status is not None and status not in STATUSES:
        raise SpecError(f"status = {status!r:.40}; allowed: {', '.join(STATUSES)}")
    names = list(plan.mechanism.responses)
    table = pa.concat_tables(store.stream(plan, ["sample", "status", "message", *columns]))
    values = {name: table[name].to_numpy() for name in columns}
    margin, nearest = _margins(plan, {name: values[name] for name in names})
    has_status = np.ones(table.num_rows, bool)
    if status is not None:
        has_status = (table["status"].to_numpy() == (OK if status == FAILED else status)) ^ (status == FAILED)
    wanted = np.flatnonzero(has_status & within(ends, values, table.num_rows))
    keys = {"margin": margin, "sample": table["sample"].to_numpy()}.get(order)
    key = (values[order] if keys is None else keys)[wanted]
    wanted = wanted[np.argsort(-key if sort != order else key, kind="stable")]  # NaN comes last
    chosen = wanted[cursor : cursor + count]
    samples = [
        ListedSample(
            **{key: row[key] for key in ("sample", "status", "message")},
            variables={name: row[name] for name in plan.spec.variables},
            responses={name: row[name] for name in names},
            margin=float(margin[at]),
            nearest=names[nearest[at]] if np.isfinite(margin[at]) else None,
        )
        for at, row in zip(chosen, table.take(pa.array(chosen)).to_pylist(), strict=True)
    ]
    following = cursor + count if cursor + count < wanted.size else None
    return SamplePage(samples=samples, total=int(wanted.size), next=following)


def ranges_of(plan: Plan, texts: Sequence[str]) -> Ranges:
    """Return the ranges of columns that texts ``COLUMN:LEAST:MOST`` give, an end may be empty; raise SpecError."""
    found: Ranges = {}
    for text in texts:
        name, *ends = text.rsplit(":", 2)
        try:
            low, high = (float(end) if end.strip() else bound for end, bound in zip(ends, (-inf, inf), strict=True))
        except ValueError:
            low = high = float("nan")
        if name not in column_names(plan) or isnan(low) or isnan(high):
            allowed = f"COLUMN:LEAST:MOST, with numbers, and COLUMN one of {', '.join(column_names(plan))}"
            raise SpecError(f"range = {text!r:.80}; allowed: {allowed}")
        least, most = found.get(name, (-inf, inf))
        found[name] = max(low, least), min(high, most)
    return found


def within(ranges: Ranges, values: Mapping[str, Array], count: int) -> NDArray[np.bool_]:
    """Return which of `count` samples are within all ranges, their ends included; one without a value is not."""
    inside = np.ones(count, bool)
    for name, (low, high) in ranges.items():
        inside &= (values[name] >= low) & (values[name] <= high)
    return inside


def sample_cloud(plan: Plan, columns: SampleColumns, ranges: Sequence[str]) -> dict[str, Any]:
    """Return at most `MOST_DRAWN` of the samples within ranges, evenly chosen, for a drawing of `MOST_AXES` columns.

    ``sample`` has their numbers, ``bad`` whether each has failed or is out of limits, and ``axes`` for each column its
    name, unit, limits, values (NaN without one), whether it is a variable, and the least and the largest of all
    samples. Columns of one value are left out.
    """
    inside = np.flatnonzero(within(ranges_of(plan, ranges), columns.values, columns.number.size))
    chosen = inside[:: -(-inside.size // MOST_DRAWN) or 1]
    limits, bad = limits_of(plan), np.zeros(chosen.size, bool)
    for name in plan.mechanism.responses:
        low, high = (bound if end is None else end for end, bound in zip(limits[name], (-inf, inf), strict=True))
        own = columns.values[name][chosen]
        bad |= ~((own >= low) & (own <= high))
    axes = [axis for name in column_names(plan) if (axis := _axis(plan, columns, name, chosen))]
    first = [axis for axis in axes if axis["lsl"] is not None or axis["usl"] is not None]
    kept = [*first, *(axis for axis in axes if axis not in first)][:MOST_AXES]
    return {
        **{"total": columns.number.size, "matching": inside.size, "sample": columns.number[chosen].tolist()},
        **{"bad": bad.tolist(), "axes": [axis for axis in axes if axis in kept]},
    }


def _axis(plan: Plan, columns: SampleColumns, name: str, chosen: NDArray[np.intp]) -> dict[str, Any] | None:
    """Return a column of a cloud; None if all its values are the same."""
    values = columns.values[name]
    finite = values[np.isfinite(values)]
    if not finite.size or not finite.max() > finite.min():
        return None
    unit = (plan.schema.field(name).metadata or {}).get(b"unit", b"").decode()
    lsl, usl = limits_of(plan).get(name, (None, None))
    return {
        **{
            "name": name,
            "is_variable": name in plan.spec.variables,
            "unit": "" if unit == "1" else unit,
            "lsl": lsl,
            "usl": usl,
        },
        **{"least": float(finite.min()), "most": float(finite.max()), "values": values[chosen].tolist()},
    }


def _margins(plan: Plan, values: Mapping[str, Array]) -> tuple[Array, Any]:
    """Return the smallest distance of each sample from a limit [sigmas], and the index of the response, both (n,)."""
    distances = []
    for name, (lsl, usl) in limits_of(plan).items():
        x = values[name]
        finite = x[np.isfinite(x)]
        sigma = float(finite.std(ddof=1)) if finite.size > 1 else 0.0
        below = np.full(x.size, np.inf) if lsl is None else x - lsl
        above = np.full(x.size, np.inf) if usl is None else usl - x
        least = np.minimum(below, above)
        distances.append(np.where(np.isfinite(least), least / sigma, np.inf) if sigma > 0 else np.full(x.size, np.inf))
    stacked = np.array(distances)
    least = stacked.min(axis=0)
    return np.where(np.isfinite(least), least, np.nan), stacked.argmin(axis=0)


def plan_with(store: Store, campaign: str, sample: int) -> Plan:
    """Return the plan of a campaign; raise SpecError if it does not have the sample."""
    plan = store.plan(campaign)
    check_sample(plan, sample)
    return plan


def check_sample(plan: Plan, sample: int) -> None:
    """Raise SpecError if the campaign does not have a sample of this number."""
    if not 0 <= sample < plan.spec.samples:
        raise SpecError(f"sample {sample}: campaign {plan.campaign_id} has samples 0 to {plan.spec.samples - 1}")


def stored_sample(store: Store, campaign: str, sample: int) -> StoredSample | None:
    """Return a sample as stored; None if it is not computed yet, or its part is broken."""
    plan = plan_with(store, campaign, sample)
    found = stored_row(store, plan, sample)
    if found is None:
        return None
    row = json_values(found)
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in plan.schema}
    told = {"sample", "status", "message", *plan.spec.variables, *plan.mechanism.responses}
    return StoredSample(
        campaign=campaign,
        sample=sample,
        status=row["status"],
        message=row["message"],
        variables={name: row[name] for name in plan.spec.variables},
        responses={name: row[name] for name in plan.mechanism.responses},
        units={name: unit for name, unit in units.items() if unit not in ("", "1")},
        certificate={name: row[name] for name in plan.schema.names if name not in told},
    )


def replay_sample(
    store: Store, campaign: str, sample: int, motion: Path | None = None, *, halved: bool = False
) -> ReplayedSample:
    """Compute a sample, or its repeat, again in this process, and compare it with its stored row, bit for bit."""
    plan = plan_with(store, campaign, sample)
    again = asdict(repeated_sample(store, plan, sample, motion, halved=halved))
    return ReplayedSample(campaign=campaign, sample=sample, **again, differences=differences(plan.row_build))


# -- jobs, which get the address of a store ---------------------------------------------------------------------------


def replay_document(store: str, campaign: str, sample: int) -> dict[str, Any]:
    """Return the document of ``clearcap replay --json``."""
    return replay_sample(open_store(store, QUICK), campaign, sample).model_dump()


def draw_sample(store: str, campaign: str, sample: int, kind: str) -> bytes:
    """Repeat a sample and return a picture of it: ``svg``, its curves over time, or ``gif``, its motion."""
    from clearcap.pictures.animation import animate
    from clearcap.pictures.run_figure import plot_run
    from clearcap.pictures.style import as_bytes

    with _repeated(store, campaign, sample) as recorded:
        if kind == "gif":
            return as_bytes("gif", lambda path: animate(recorded, path, ANIMATION_FRAMES))
        return as_bytes(kind, lambda path: plot_run(recorded, path))


def sample_motion(store: str, campaign: str, sample: int) -> dict[str, Any]:
    """Repeat a sample and return its motion, a `MovingDrawing`; see `draw_sample` for the parameters."""
    from clearcap.pictures.moving_drawing import moving_drawing
    from clearcap.pictures.scene import scene_of

    with _repeated(store, campaign, sample) as recorded:
        return asdict(moving_drawing(scene_of(recorded, ANIMATION_FRAMES)))


@contextmanager
def _repeated(store: str, campaign: str, sample: int) -> Iterator[Trajectory]:
    """Repeat a sample and yield its trajectory, whose file exists only in the block."""
    with TemporaryDirectory(prefix="clearcap-") as folder:
        motion = Path(folder, "motion.h5")
        replay_sample(open_store(store, QUICK), campaign, sample, motion)
        yield read_trajectory(motion)
