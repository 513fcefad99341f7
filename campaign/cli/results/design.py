"""``clearcap design``: a campaign file that aims at rare rejects, from the rows of another campaign."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, print_table, print_text, say

if TYPE_CHECKING:
    from campaign.reports.aimed_campaign import AimedCampaign


def design(
    campaign: Id = None,
    response: Annotated[
        list[str], typer.Option(metavar="NAME", help="Aim at the limits of this response only; may be repeated.")
    ] = [],  # noqa: B006
    samples: Annotated[int, typer.Option(min=1, help="Number of samples of the new campaign.")] = 20_000,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Campaign file to write; NAME-rare.toml by default.")
    ] = None,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Write a campaign file with importance sampling that aims where the rows of a campaign expect rejects."""
    import tomli_w

    from campaign.cli.output_files import check_output, replacing
    from campaign.reports.aimed_campaign import aimed_campaign
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK

    opened = open_store(store, QUICK)
    plan = opened.plan(opened.find(campaign))
    aimed = aimed_campaign(opened, plan, samples, response)
    path = output or Path(f"{aimed.tables['name']}.toml")
    check_output("--output", path, (".toml",))
    with replacing(path) as temporary:
        temporary.write_text(
            f"# Aims at the rejects that {plan.campaign_id} shows or predicts.\n{tomli_w.dumps(aimed.tables)}"
        )
    if json:
        print_json({"campaign": plan.campaign_id, "store": opened.url, "file": str(path), **_plain(aimed)})
    else:
        _print(aimed)
        print_text(f"wrote {path}; compute it with: {opened.command('run', str(path))}")
    if not any(target.centres for target in aimed.targets):
        say("no limit needs a separate component: one wide component bounds what no run has shown")


def _plain(aimed: "AimedCampaign") -> dict[str, object]:
    """Return targets and components as plain data."""
    from dataclasses import asdict

    return {
        "targets": [asdict(target) for target in aimed.targets],
        "components": aimed.tables["importance"]["components"],
    }


def _print(aimed: "AimedCampaign") -> None:
    """Print the expected rejects beyond each limit, and where the components draw."""
    rows = [(t.name, f"{t.ppm:.3g}", t.by, "yes" if t.centres else "no need") for t in aimed.targets]
    print_table("rejects expected beyond each limit", ("limit", "ppm, roughly", "by", "aimed at"), rows, texts=1)
    rows = [
        (f"{100 * aim.share:.1f} %", f"{aim.scale:g}", _centre(aim.centre, aimed.variables), aim.source)
        for aim in aimed.aims
    ]
    rest = 1.0 - sum(aim.share for aim in aimed.aims)
    rows.append((f"{100 * rest:.1f} %", "1", _centre((), ()), "nothing: production itself"))
    print_table("components, in standard scores", ("share", "scale", "centre", "aims at"), rows)


def _centre(centre: tuple[float, ...], names: tuple[str, ...]) -> str:
    """Return a centre in words."""
    return ", ".join(f"{name} {z:+.2f}" for name, z in zip(names, centre, strict=True) if z) or "that of production"
