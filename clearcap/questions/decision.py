"""What plain samples leave open, decided by campaigns that aim at the rejects: which responses, and which campaigns.

A plain campaign of a few hundred samples seldom makes a verdict certain: it shows neither a share of some ppm nor a
small second population. The model is at hand, so a further campaign draws where its rows expect rejects, and its
weighted runs decide. What they leave open gets another one, which aims where they have found rejects, until all is
decided or the runs are used up. Each is an importance campaign like any other in the same store, and the last that
finds an interval of a response decides it alone: weights of runs that have chosen where to aim would be too small. Its
file is a function of the rows before, so a later call continues with the same bits.
"""

from collections.abc import Callable

from campaign.coordinator.requests import refuse_signed
from campaign.coordinator.submit import submit
from campaign.errors import CampaignError, SpecError, StoreError
from campaign.plan import Plan
from campaign.spec.campaign_file import CampaignSpec, Decide
from campaign.spec.load import Campaign
from campaign.store import Store
from campaign.store.labels import LabelChange, read_labels
from campaign.store.layout import DECISION, SUBMISSION
from campaign.waits import counted
from campaign.worker.messages import check_build
from clearcap.questions.aimed_campaign import Stage, aimed_campaign, decided_by
from clearcap.questions.report import analysis
from reporting.analysis import Analysis

# Runs of an aimed campaign, and more for each open response, as far as the campaign's `decide.runs` reach. A quarter
# looks for rejects where nothing aims: 300 of these without a reject leave room for 5 ppm behind a flat limit.
RUNS, RUNS_EACH, WIDE_SHARE = 1_000, 250, 0.25
FEWEST_RUNS = 500  # of a further campaign: the one before gets what would be left for less


def decide(store: Store, plan: Plan, compute: Callable[[Plan], object], say: Callable[[str], object]) -> None:
    """Compute the aimed campaigns that a complete campaign needs, one after the other; `compute` completes one.

    If one cannot be completed, `say` is told why, and the verdicts stay as they are. Raises StoreError.
    """
    try:
        while (planned := plan_decision(store, plan)) is not None:
            decides, names = planned
            say(
                f"not certain: {', '.join(names)}; {counted(decides.spec.samples, 'run')} that aim at their rejects"
                f" decide (campaign {decides.campaign_id})"
            )
            compute(decides)
    except StoreError:
        raise
    except CampaignError as error:
        say(f"{plan.campaign_id}: nothing more is decided: {error}")


def plan_decision(store: Store, plan: Plan) -> Stage | None:
    """Return the next campaign that decides what a complete campaign leaves open, and the open responses.

    None if every verdict is certain, no runs are left (the campaign file may say `decide = {runs = 0}`), or the samples
    cannot be weighted. Raises SignedCampaign if the verdicts are signed, WrongBuild if the rows are of another build.
    """
    stages = decided_by(store, plan)
    if stages and store.survey(stages[-1][0]).missing:
        return stages[-1]
    left = (plan.spec.decide or Decide()).runs - sum(decides.spec.samples for decides, _ in stages)
    if left < (FEWEST_RUNS if stages else 1) or plan.spec.sampler != "random" or store.survey(plan).missing:
        return None
    names = open_responses(analysis(store, plan))
    if not names:
        return None
    refuse_signed(store, plan.campaign_id)
    check_build(plan.campaign_id, plan.row_build)
    before = stages[-1][0] if stages else plan
    try:
        runs = RUNS + RUNS_EACH * len(names)
        aimed = aimed_campaign(store, before, left if left - runs < FEWEST_RUNS else runs, names, WIDE_SHARE)
    except (SpecError, CampaignError):  # production batches, or too few rows for a model
        return None
    spec = CampaignSpec.model_validate(aimed.tables)
    labels = LabelChange(read_labels(store, plan.campaign_id).owner or None)
    by = (store.read_json(plan.campaign_id, SUBMISSION) or {}).get("user")  # whose rights it has
    decides = submit(store, Campaign(spec, plan.mechanism), tries_runs=False, labels=labels, by=by)
    every = [*stages, (decides, names)]
    known = [{"campaign": each.campaign_id, "responses": list(of_each)} for each, of_each in every]
    store.write_json(plan.campaign_id, DECISION, {"stages": known})
    return decides, names


def open_responses(found: Analysis) -> tuple[str, ...]:
    """Return the responses with a verdict that is not certain."""
    return tuple(r.spec.name for r in found.responses if r.verdict.certain is False)
