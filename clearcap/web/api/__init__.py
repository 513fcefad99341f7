"""The calls of the HTTP API, with one module for each subject."""

from fastapi import APIRouter

from clearcap.web.api import (
    campaign_changes,
    campaigns,
    mechanisms,
    operation,
    questions,
    reports,
    samples,
    shares,
    signoffs,
    submissions,
    users,
    webhooks,
)

# one router on each line
ROUTERS = [
    operation.health_router,
    mechanisms.mechanisms_router,
    mechanisms.simulations_router,
    campaigns.router,
    submissions.router,
    campaign_changes.router,
    reports.router,
    questions.router,
    samples.router,
    users.users_router,
    users.account_router,
    users.tokens_router,
    operation.audit_router,
    shares.router,
    signoffs.router,
    webhooks.router,
]


def routers() -> list[APIRouter]:
    """Return the routers of all calls."""
    return ROUTERS
