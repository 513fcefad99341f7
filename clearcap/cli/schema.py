"""``clearcap schema``: JSON Schemas of the file formats, for editors and other programs."""

import typer

from clearcap.cli.output import Json, print_json

schema_app = typer.Typer(help="Print the JSON Schema of a file format.", no_args_is_help=True)


@schema_app.command()
def mechanism(json: Json = False) -> None:
    """Print the JSON Schema of mechanism files."""
    from engine.mechanism import mechanism_schema

    print_json(mechanism_schema())


@schema_app.command()
def campaign(json: Json = False) -> None:
    """Print the JSON Schema of campaign files."""
    from campaign.spec.campaign_file import campaign_schema

    print_json(campaign_schema())


@schema_app.command()
def report(json: Json = False) -> None:
    """Print the JSON Schema of a report's capability.json."""
    from reporting.render.json import report_schema

    print_json(report_schema())
