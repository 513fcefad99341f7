"""The calls of the HTTP API, with one module for each kind of resource."""

from fastapi import APIRouter

from campaign.web.api import (
    account,
    audit_trail,
    campaign_changes,
    campaigns,
    health,
    mechanisms,
    questions,
    reports,
    rows,
    samples,
    shares,
    signoffs,
    simulations,
    submissions,
    tokens,
    users,
    webhooks,
)

# one router on each line
ROUTERS = [
    health.router,
    mechanisms.router,
    simulations.router,
    campaigns.router,
    submissions.router,
    campaign_changes.router,
    reports.router,
    questions.router,
    rows.router,
    samples.router,
    users.router,
    account.router,
    tokens.router,
    audit_trail.router,
    shares.router,
    signoffs.router,
    webhooks.router,
]


def routers() -> list[APIRouter]:
    """Return the routers of all calls."""
    return ROUTERS
