"""``clearcap report``: write the report of a campaign from the rows it has."""

from typing import Annotated

import typer

from campaign.cli.drive import fail_without_enough_ok
from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, print_text


def report(
    campaign: Id = None,
    store: StoreUrl = "runs",
    against: Annotated[
        str | None, typer.Option(metavar="ID", help="Compare with another campaign, as a document of its own.")
    ] = None,
    pdf: Annotated[
        bool, typer.Option("--pdf/--no-pdf", help="Also write report.pdf, which takes most of the time.")
    ] = False,
    summary: Annotated[
        bool, typer.Option("--summary", help="Also write summary.html, one page to sign; with --pdf summary.pdf too.")
    ] = False,
    excel: Annotated[bool, typer.Option("--excel/--no-excel", help="Also write report.xlsx.")] = True,
    json: Json = False,
) -> None:
    """Write the report of a campaign from the rows computed so far; the campaign may be running.

    The exit status is 1 if too few of its runs are ok for a verdict.
    """
    from campaign.errors import CampaignError
    from campaign.reports.report import report as write_report
    from campaign.store import open_store
    from campaign.store.files.patience import QUICK
    from reporting.write import lacks_package

    if pdf and lacks_package("pdf"):
        raise CampaignError(
            "--pdf: WeasyPrint is not installed; nothing was written. pip install 'clearcap[pdf]', or leave --pdf out"
        )

    opened = open_store(store, QUICK)
    plan = opened.plan(opened.find(campaign))
    asked = {"pdf": pdf, "xlsx": excel, "summary": summary, "summary_pdf": summary and pdf}
    kinds = ["html", "json", "parquet", *(kind for kind, is_asked in asked.items() if is_asked)]
    files = write_report(opened, plan, kinds=kinds, against=against)
    if json:
        other = None if against is None else opened.find(against)
        print_json({"campaign": plan.campaign_id, "store": opened.url, "against": other, "report": files})
    else:
        for path in files.values():
            print_text(f"{'report' if against is None else 'comparison'}: {path}")
    fail_without_enough_ok(opened, plan, opened.survey(plan).statuses)
