"""Cautions before the first run of a campaign: what looks wrong in it, although it could run."""

from collections.abc import Iterator

import numpy as np

from campaign.spec.load import Campaign
from engine import EngineError, check, set_values
from engine.mechanism import Mechanism
from engine.preflight import Caution, cautions
from engine.preflight.step_trial import step_caution


def campaign_cautions(campaign: Campaign) -> Iterator[Caution]:
    """Yield the cautions of `clearcap mechanism check` with all variables at their medians, and one for a long step.

    A fixed step that the campaign sets is tried on one run; if the mechanism does not come to rest with it, shorter
    steps are tried too.

    Parameters
    ----------
    campaign : Campaign
        A campaign checked by `campaign.spec.load.load_campaign`.
    """
    mechanism, settings = _typical(campaign), campaign.spec.simulation
    yield from cautions(mechanism)
    if settings.step is not None:
        caution = step_caution(mechanism, settings.step, settings.horizon)
        if caution:
            yield caution


def _typical(campaign: Campaign) -> Mechanism:
    """Return the mechanism with all variables at their medians, or unchanged if it refuses these values."""
    medians = {
        variable.target or name: float(variable.ppf(np.array([0.5]))[0])
        for name, variable in campaign.spec.variables.items()
    }
    try:
        changed = set_values(campaign.mechanism, {**medians, **campaign.spec.simulation.values()})
        check(changed)
    except EngineError:
        return campaign.mechanism
    return changed
