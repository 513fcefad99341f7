"""What plain samples leave open, decided by a campaign that aims at the rejects: which responses, and which campaign.

A plain campaign of a few hundred samples seldom makes a verdict certain: it shows neither a share of some ppm nor a
small second population. The model is at hand, so a further campaign draws where its rows expect rejects, and its
weighted runs decide. It is an importance campaign like any other in the same store. Its file is a function of the plain
rows, so a later call continues it with the same bits.
"""

from campaign.coordinator.requests import refuse_signed
from campaign.coordinator.submit import submit
from campaign.errors import CampaignError, SpecError
from campaign.plan import Plan
from campaign.spec.campaign_file import CampaignSpec, Decide
from campaign.spec.load import Campaign
from campaign.store import Store
from campaign.store.layout import DECISION
from clearcap.questions.aimed_campaign import aimed_campaign, decided_by
from clearcap.questions.report import analysis
from reporting.analysis import Analysis

# Runs of the aimed campaign, and more for each open response, up to the campaign's `decide.runs`. A quarter looks for
# rejects where nothing aims: 300 of these without a reject leave room for 5 ppm behind a flat limit.
RUNS, RUNS_EACH, WIDE_SHARE = 1_000, 250, 0.25


def plan_decision(store: Store, plan: Plan) -> tuple[Plan, tuple[str, ...]] | None:
    """Plan the campaign that decides what a complete campaign leaves open; return it and the open responses.

    None if every verdict is certain, the campaign file says `decide = {runs = 0}`, or its samples cannot be weighted.
    Raises SignedCampaign if its verdicts are signed.
    """
    known = decided_by(store, plan)
    if known is not None:
        return known
    most = (plan.spec.decide or Decide()).runs
    if not most or plan.spec.sampler != "random" or store.survey(plan).missing:
        return None
    refuse_signed(store, plan.campaign_id)
    names = open_responses(analysis(store, plan))
    if not names:
        return None
    try:
        aimed = aimed_campaign(store, plan, min(most, RUNS + RUNS_EACH * len(names)), names, WIDE_SHARE)
    except (SpecError, CampaignError):  # production batches, or too few rows for a model
        return None
    spec = CampaignSpec.model_validate(aimed.tables)
    decides = submit(store, Campaign(spec, plan.mechanism), tries_runs=False)
    store.write_json(plan.campaign_id, DECISION, {"campaign": decides.campaign_id, "responses": list(names)})
    return decides, names


def open_responses(found: Analysis) -> tuple[str, ...]:
    """Return the responses with a verdict that is not certain."""
    return tuple(r.spec.name for r in found.responses if r.verdict.certain is False)
