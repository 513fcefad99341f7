"""The pages: HTML rendered on the server, with htmx for live parts; every form works without scripts."""

from pathlib import Path

from fastapi import APIRouter

from campaign.web.pages import (
    account,
    admin,
    campaigns,
    company,
    help,
    login,
    mechanisms,
    new_campaign,
    share,
    signoff,
    trial,
)
from campaign.web.pages.exploring import compare, export, samples, whatif

STATIC = Path(__file__).parent / "static"


def page_routers() -> list[APIRouter]:
    """Return the routers of all pages; none is part of the documented API."""
    of_people = [help.router, login.router, company.router, account.router, admin.router]
    of_mechanisms = [trial.router, mechanisms.router]
    of_rows = [whatif.router, samples.router, compare.router, export.router]
    of_campaigns = [new_campaign.router, campaigns.router, *of_rows, share.router, signoff.router]
    return [*of_people, *of_mechanisms, *of_campaigns]
