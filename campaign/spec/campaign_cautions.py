"""Before the first run of a campaign: what looks wrong in it, although it could run, and what its file asks."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from campaign.inputs.distributions.discrete import Empirical
from campaign.spec.load import Campaign
from engine import EngineError, check, set_values
from engine.cad_import.proposed_text import questions_of_file
from engine.mechanism import Mechanism
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml
from engine.preflight import Caution, cautions
from engine.preflight.cautions import step_caution
from reporting.capability.row_order import row_order


def campaign_cautions(campaign: Campaign) -> Iterator[Caution]:
    """Yield the cautions of `clearcap mechanism check` with all variables at their medians, and the campaign's own."""
    # Measured values that a variable draws again in any order must come from a stable process. A fixed step that the
    # campaign sets is tried on one run; if the mechanism does not come to rest with it, shorter steps are tried too.
    mechanism, settings = _typical(campaign), campaign.spec.simulation
    yield from cautions(mechanism)
    yield from _drifting_values(campaign)
    if settings.step is not None:
        caution = step_caution(mechanism, settings.step, settings.horizon)
        if caution:
            yield caution


def _drifting_values(campaign: Campaign) -> Iterator[Caution]:
    """Yield the measured values that drift from row to row, or resemble their neighbours."""
    for name, variable in campaign.spec.variables.items():
        if isinstance(variable, Empirical) and variable.values and not variable.joint:  # draws have no order
            order = row_order(np.array(variable.values))
            if order is not None and order.finding:
                yield Caution(
                    f"variables.{name}",
                    None,
                    "1",
                    f"the measured values are not in random order: {order.seen}; in the order of production that means"
                    " that the process was not stable, and that they say little about what it will make",
                    "",
                    "find the cause and measure again; if the rows were sorted, it means nothing",
                )


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


# -- questions still open in a campaign file and in the mechanism file that it names -----------------------------------


def campaign_questions(campaign: object) -> Iterator[str]:
    """Yield the open questions of a campaign file, given by its path, each with its file and line."""
    if not isinstance(campaign, str | Path):
        return
    yield from _said(campaign)
    mechanism = _tables(Path(campaign)).get("mechanism")
    if isinstance(mechanism, str) and (Path(mechanism).suffix == ".toml" or len(Path(mechanism).parts) > 1):
        yield from _said(Path(campaign).parent / mechanism)


def _said(path: str | Path) -> Iterator[str]:
    for question in questions_of_file(path):
        yield f"question: {path}, line {question.line}: {question.text}"


def _tables(path: Path) -> Mapping[str, Any]:
    """Return the tables of a file; empty if it cannot be read, as loading it reports the reason."""
    try:
        return parse_toml(read_regular_file(path, LARGEST))
    except (OSError, ValueError, UnfitToml):
        return {}
