"""The pages: HTML rendered on the server, with htmx for live parts; every form works without scripts."""

from pathlib import Path

from fastapi import APIRouter

from clearcap.web.pages import account, admin, campaigns, help, login, mechanisms, new_campaign, rows, whatif

STATIC = Path(__file__).parent / "static"


def page_routers() -> list[APIRouter]:
    """Return the routers of all pages; none is part of the documented API."""
    of_people = [help.router, login.router, account.router, admin.router]
    of_campaigns = [new_campaign.router, campaigns.router, whatif.router, rows.router]
    return [*of_people, mechanisms.router, *of_campaigns]
