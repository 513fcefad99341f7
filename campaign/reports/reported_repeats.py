"""The repeats of a campaign in the form that `reporting` needs."""

from campaign.plan import Plan
from campaign.row_build import differences
from campaign.store import Store
from campaign.store.repeat_sets import read_repeats, repeat_plans, repeated_shares, survey_repeats
from reporting.samples import Repeats
from reporting.samples import read_repeats as checked

ASKED, MOST = 0.1, 1.0  # shares


def repeats_of(store: Store, plan: Plan) -> Repeats:
    """Return the stored repeats of a campaign, and advice on how to get more."""
    responses = tuple(plan.mechanism.responses)
    survey = survey_repeats(store, repeat_plans(store, plan))
    table = read_repeats(store, plan, ["sample", "status", *responses])
    return checked(table, responses, survey.planned, _remedy(store, plan, bool(survey.missing)))


def _remedy(store: Store, plan: Plan, is_missing: bool) -> str:
    """Return advice on how to get more repeats; empty if all samples are repeated."""
    if differences(plan.row_build):
        return "Repeats need the build of clearcap that planned the campaign; a new clearcap run plans it again."
    if is_missing:
        return f"To compute the missing ones: {store.command('resume', plan.campaign_id)}."
    share = repeated_shares(store, plan)[-1]
    if share >= MOST:
        return ""
    more = f"{min(max(2 * share, ASKED), MOST):g}"
    command = store.command("repeat", plan.campaign_id, "--share", more)
    return f"To repeat {'more' if share else 'some'}: {command}"
