"""``clearcap replay``: repeat one run of a campaign, bit for bit."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.options import CampaignId, StoreUrl
from campaign.cli.output import Json, print_json, print_text, say
from campaign.cli.run_files import RunFiles

if TYPE_CHECKING:
    from campaign.plan import Plan
    from campaign.plan_header import PlanHeader
    from campaign.store import Store


def replay(
    campaign: CampaignId,
    sample: Annotated[int, typer.Argument(min=0, help="Number of the sample.")],
    store: StoreUrl = "runs",
    trajectory: Annotated[Path | None, typer.Option(help="Write the motion to an HDF5 file: .h5.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw curves over time: .png, .svg or .pdf.")] = None,
    animation: Annotated[Path | None, typer.Option("--animate", help="Draw the motion: .gif, .html or .mp4.")] = None,
    halved: Annotated[bool, typer.Option("--repeat", help="With half the step: the sample's repeat.")] = False,
    json: Json = False,
) -> None:
    """Repeat one run of a campaign in this process, and compare it with its stored row, bit for bit."""
    from campaign.row_build import differences
    from campaign.store import open_store
    from campaign.store.repeat_sets import repeat_plans

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    _check(plan, sample)
    files = RunFiles(trajectory, plot, animation)
    files.check()
    if different := differences(plan.row_build):
        say(f"the campaign was computed with another build of clearcap, so numbers may differ: {different}")
    with files.recording() as motion:
        row = _repeat(plan, sample, motion, halved=halved)
    tables = repeat_plans(opened, plan) if halved else (plan,)
    stored = next((found for table in tables if (found := _stored(opened, table, sample))), None)
    same = None if stored is None else _same(row, stored, list(plan.mechanism.responses))
    if json:
        print_json({"campaign": campaign, "sample": sample, "row": row, "stored": stored, "same": same})
    else:
        _print(plan, row, same, "repeat" if halved else "row")
    if same is False and not different:
        raise typer.Exit(1)


def _check(plan: "Plan", sample: int) -> None:
    """Refuse a sample that the campaign does not have."""
    from campaign.errors import SpecError

    if sample >= plan.spec.samples:
        raise SpecError(f"sample {sample}: campaign {plan.campaign_id} has samples 0 to {plan.spec.samples - 1}")


def _repeat(plan: "Plan", sample: int, motion: Path | None, *, halved: bool) -> dict[str, Any]:
    """Return the row of a sample, or its repeat with half the step, computed here as a worker would."""
    from campaign.worker.compiling import announced_compilation
    from campaign.worker.halved_step import HalvedStep
    from campaign.worker.row import compute_row, sample_values
    from engine import missing_kernels, simulate, warm_up
    from engine.loop import Cancel

    with announced_compilation(missing_kernels()):
        warm_up()  # before any clock runs
    run = partial(simulate, trajectory=motion) if motion else simulate
    return compute_row(plan, HalvedStep(run) if halved else run, sample, sample_values(plan, sample), 1, Cancel())


def _stored(store: "Store", table: "PlanHeader", sample: int) -> dict[str, Any] | None:
    """Return the row of a sample as the store has it, in a campaign or a set of its repeats; None if it has none."""
    from campaign.store import BadPart

    at = table.rows_before(sample)
    if table.numbers_of(at, at + 1) != [sample]:
        return None
    batch = next(b for b, (first, count) in enumerate(table.batches) if first <= at < first + count)
    try:
        rows = store.read_part(table, batch)
    except (FileNotFoundError, BadPart):
        return None
    row: dict[str, Any] = rows.slice(at - table.batches[batch][0], 1).to_pylist()[0]
    return row


def _same(row: dict[str, Any], stored: dict[str, Any], responses: list[str]) -> bool:
    """Return whether two rows agree in all that the sample determines."""
    names = ["status", "message", "steps", "max_residual", "max_penetration", "settled", *responses]
    return all(_equal(row[name], stored[name]) for name in names)


def _equal(a: Any, b: Any) -> bool:
    """Return whether two values are equal; NaN equals NaN."""
    both_nan = isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b)
    return bool(a == b or both_nan)


def _print(plan: "Plan", row: dict[str, Any], same: bool | None, what: str) -> None:
    """Print the row or the repeat, and whether it equals that of the store."""
    print_text(f"sample {row['sample']}: {row['status']}{': ' if row['message'] else ''}{row['message']}")
    units = plan.mechanism.response_units()
    for name in plan.spec.variables:
        print_text(f"  {name} = {row[name]:.10g}")
    for name in plan.mechanism.responses:
        unit = "" if units[name] == "1" else f" {units[name]}"
        value = "-" if row[name] is None else f"{row[name]:.10g}{unit}"
        print_text(f"{name}  {value}")
    words = {
        None: f"the store has no {what} of this sample yet",
        True: f"equal to the {what} in the store, bit for bit",
        False: f"differs from the {what} in the store",
    }
    print_text(words[same])
