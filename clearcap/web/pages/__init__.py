"""The pages: HTML rendered on the server, with htmx for live parts; every form works without scripts."""

from pathlib import Path

from fastapi import APIRouter

from clearcap.web.pages import admin, campaigns, login, measured, mechanisms, new_campaign, rows, whatif

STATIC = Path(__file__).parent / "static"


def page_routers() -> list[APIRouter]:
    """Return the routers of all pages; none is part of the documented API."""
    every = (login, admin, mechanisms, new_campaign, campaigns, rows, whatif, measured)
    return [each.router for each in every]
