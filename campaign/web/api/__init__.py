"""The calls of the HTTP API, a module for each kind of thing."""

from fastapi import APIRouter

from campaign.web.api import campaign_changes, campaigns, health, reports


def routers() -> list[APIRouter]:
    """Return the routers of all calls."""
    return [health.router, campaigns.router, campaign_changes.router, reports.router]
