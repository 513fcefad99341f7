"""``clearcap replay``: repeat one run of a campaign, bit for bit."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.options import CampaignId, StoreUrl
from campaign.cli.output import Json, print_json, print_text, say
from campaign.cli.run_files import RunFiles

if TYPE_CHECKING:
    from campaign.plan import Plan


def replay(
    campaign: CampaignId,
    sample: Annotated[int, typer.Argument(min=0, help="Number of the sample.")],
    store: StoreUrl = "runs",
    trajectory: Annotated[Path | None, typer.Option(help="Write the motion to an HDF5 file: .h5.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw curves over time: .png, .svg or .pdf.")] = None,
    animation: Annotated[Path | None, typer.Option("--animate", help="Draw the motion: .gif, .html or .mp4.")] = None,
    halved: Annotated[bool, typer.Option("--repeat", help="The sample's repeat, with half the step.")] = False,
    json: Json = False,
) -> None:
    """Repeat one run of a campaign in this process, and compare it with its stored row, bit for bit."""
    from campaign.reports.replayed import check_sample, replay_sample
    from campaign.row_build import differences
    from campaign.store import open_store

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    check_sample(plan, sample)
    files = RunFiles(trajectory, plot, animation)
    files.check()
    if different := differences(plan.row_build):
        say(f"the campaign was computed with another build of clearcap, so numbers may differ: {different}")
    with files.recording() as motion:
        replayed = replay_sample(opened, plan, sample, motion, halved=halved)
    if json:
        print_json(replayed.document())
    else:
        _print(plan, replayed.again.row, replayed.again.same, "repeat" if halved else "row")
    if replayed.is_broken:
        raise typer.Exit(1)


def _print(plan: "Plan", row: dict[str, Any], same: bool | None, what: str) -> None:
    """Print the row or the repeat, and whether it equals the stored one."""
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
