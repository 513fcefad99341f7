"""What would the responses be under other distributions of the variables? Answered without new runs."""

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.reports.changed_distributions import change_distributions, check_drawn
from campaign.reports.samples import independent_samples, limits_of
from campaign.reports.variable_settings import changed_variables
from campaign.store import Store
from reporting import ReportError
from reporting.tolerance.whatif import WhatIf, what_if_all


def what_if(store: Store, plan: Plan, settings: list[str]) -> dict[str, WhatIf]:
    """Return every response under changed distributions.

    Parameters
    ----------
    store : Store
        Where the campaign is.
    plan : Plan
        The campaign.
    settings : list of str
        See `campaign.reports.variable_settings.changed_variables`.

    Returns
    -------
    dict of str to WhatIf
        By response.

    Raises
    ------
    SpecError
        If a setting is not possible, or the samples are not drawn from distributions.
    CampaignError
        If there are no samples.
    """
    check_drawn(plan.spec)
    changed = changed_variables(plan.spec, settings).variables
    samples, lots = independent_samples(store, plan)
    responses = {name: samples[name] for name in plan.mechanism.responses}
    try:
        change = change_distributions(plan.spec, changed, samples)
        return what_if_all(responses, change, limits_of(plan), lots=lots)
    except ReportError as error:
        raise CampaignError(f"what if of {plan.campaign_id}: {error}") from error
