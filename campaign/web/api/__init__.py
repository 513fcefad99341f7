"""The calls of the HTTP API, a module for each kind of thing."""

from fastapi import APIRouter

from campaign.web.api import (
    account,
    audit_trail,
    campaign_changes,
    campaigns,
    health,
    reports,
    shares,
    signoffs,
    tokens,
    users,
)


def routers() -> list[APIRouter]:
    """Return the routers of all calls."""
    of_campaigns = [campaigns.router, campaign_changes.router, reports.router]
    of_people = [users.router, account.router, tokens.router, audit_trail.router, shares.router, signoffs.router]
    return [health.router, *of_campaigns, *of_people]
