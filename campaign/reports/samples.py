"""Samples of a campaign as columns, for questions that need no new runs."""

import numpy as np

from campaign.errors import CampaignError
from campaign.inputs.sampling import sampler_named
from campaign.plan import Plan
from campaign.spec.campaign_file import Response
from campaign.store import Store
from engine.arrays import Array

Limits = dict[str, tuple[float | None, float | None]]


def independent_samples(store: Store, plan: Plan) -> dict[str, Array]:
    """Return the variables and responses of all samples that are independent draws.

    Parameters
    ----------
    store : Store
        Where the campaign is.
    plan : Plan
        The campaign.

    Returns
    -------
    dict of str to ndarray, each of shape (n,)
        By name; NaN where a run has no value.

    Raises
    ------
    CampaignError
        If there are no rows.
    """
    names = [*plan.spec.variables, *plan.mechanism.responses]
    pieces: dict[str, list[Array]] = {name: [] for name in names}
    for table in store.stream(plan, ["sample", *names]):
        rows = sampler_named(plan.spec.sampler).independent(plan.spec, table["sample"].to_numpy())
        for name in names:
            pieces[name].append(table[name].to_numpy()[rows])
    if not pieces[names[0]]:
        raise CampaignError(f"{plan.campaign_id}: no sample is computed yet; wait for the first, or run the campaign")
    return {name: np.concatenate(pieces.pop(name)) for name in names}


def limits_of(plan: Plan) -> Limits:
    """Return lower and upper limit of every response of the mechanism; None where there is none."""
    return {name: plan.spec.responses.get(name, Response()).limits()[:2] for name in plan.mechanism.responses}
