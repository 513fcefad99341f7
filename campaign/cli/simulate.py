"""``clearcap simulate``: one run of one mechanism."""

from dataclasses import asdict
from typing import Annotated

import typer

from campaign.cli.output import Json, print_json


def simulate(
    mechanism: Annotated[str, typer.Argument(help="A shipped mechanism or a mechanism file.")],
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Set a joint's clearance or any key; may be repeated."),
    ] = None,
    step: Annotated[float | None, typer.Option(help="Time step, instead of the file's.")] = None,
    horizon: Annotated[float | None, typer.Option(help="Longest simulated time, instead of the file's.")] = None,
    full_horizon: Annotated[bool, typer.Option("--full-horizon", help="Go on after rest.")] = False,
    json: Json = False,
) -> None:
    """Simulate a mechanism once and print its responses."""
    values = _values(changes or [])
    from engine import load_mechanism
    from engine import simulate as simulate_once

    run = simulate_once(load_mechanism(mechanism), values, step=step, horizon=horizon, full_horizon=full_horizon)
    if json:
        face = {"status": run.status, "message": run.message, "responses": run.responses, "units": run.units}
        print_json({**face, "certificate": asdict(run.certificate)})
    else:
        print(f"{run.status}{': ' if run.message else ''}{run.message}")
        width = max(map(len, run.responses), default=0)
        for name, value in run.responses.items():
            print(f"{name:{width}}  {value:.10g} {run.units[name]}")
        print("\n".join(f"  {name} = {value}" for name, value in asdict(run.certificate).items()))
    if run.status != "ok":
        raise typer.Exit(1)


def _values(changes: list[str]) -> dict[str, float]:
    """Return the values of ``KEY=VALUE`` options."""
    from campaign.errors import SpecError

    values: dict[str, float] = {}
    for change in changes:
        key, equals, text = change.partition("=")
        try:
            number = float(text)
        except ValueError:
            equals = ""
        if not equals or not key:
            raise SpecError(f"--set {change}: not KEY=VALUE with a number; write for example --set J1=0.05")
        if key in values:
            raise SpecError(f"--set {change}: {key} is set twice; keep one of them")
        values[key] = number
    return values
