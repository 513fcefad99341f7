"""``clearcap polarisation``: the positions of journals in their bearings over the first samples of a campaign."""

from pathlib import Path
from typing import Annotated

import typer

from campaign.cli.output import Json, print_json, print_text, say


def polarisation(
    campaign: Annotated[str, typer.Argument(help="A shipped campaign or a campaign file.")],
    picture: Annotated[Path, typer.Argument(help="Picture file to write: .png, .svg or .pdf.")],
    samples: Annotated[int, typer.Option(min=1, help="Number of samples to simulate, counted from the first.")] = 100,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of worker processes; by default one per core.")
    ] = None,
    json: Json = False,
) -> None:
    """Draw where each journal lies in its bearing at the end of the runs, and the direction in which it presses."""
    from campaign.cli.output_files import PLOTS, check_output, replacing
    from campaign.cluster.local import cores
    from campaign.errors import CampaignError
    from campaign.pictures.polarisation import plot_polarisation
    from campaign.reports.journal_positions import campaign_journal_positions
    from campaign.spec.load import load_campaign

    check_output("polarisation", picture, PLOTS)
    loaded = load_campaign(campaign, samples=samples)
    say(f"simulating {samples} samples")
    journals = campaign_journal_positions(loaded, workers or cores())
    if not journals:
        raise CampaignError(
            f"polarisation: no journal to draw: either {loaded.mechanism.name} has no round joint with clearance, or "
            f"all {samples} runs failed; look at one run with clearcap simulate"
        )
    with replacing(picture) as temporary:
        plot_polarisation(journals, f"{loaded.spec.title or loaded.spec.name}, where journals lie", temporary)
    failed = samples - len(journals[0].eccentricities)
    if json:
        print_json({"picture": str(picture), "samples": samples, "failed": failed})
    else:
        print_text(f"picture: {picture}" + (f" ({failed} of {samples} runs failed and are left out)" if failed else ""))
