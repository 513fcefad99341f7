"""Write campaign files: from the tables that a form or a program has filled in, or proposed from a CAD file."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import tomli_w

from campaign.spec.campaign_file import CampaignSpec

if TYPE_CHECKING:
    from engine.cad_import.proposed_joints import Diameter

CPK = 1.33  # assumed for a dimension if only its limits are known, as in the docs
SAMPLES = 1000

_HEAD = """\
# Proposed by clearcap mechanism import from the limits of size in the CAD file: of each diameter the middle of its
# limits, and half of what lies between them. The Cpk with which it is made is an assumption.
#? variables: with which Cpk, or which distribution, is each of these diameters made?
#? responses: what are the limits of what is read off? Give lsl and usl in [responses.NAME]
"""


def campaign_text(tables: Mapping[str, Any]) -> str:
    """Return the text of a campaign file.

    Parameters
    ----------
    tables : mapping
        The tables of the file as Python data, valid or not; entries that are None are left out.

    Returns
    -------
    str
        TOML with the same values. Top-level keys are in reading order: format, name, mechanism, ..., variables,
        responses; keys inside a table keep their order.

    Raises
    ------
    TypeError
        If a value in the tables has no equivalent in TOML.
    """
    known = {key: tables[key] for key in CampaignSpec.model_fields if key in tables}
    return tomli_w.dumps(_given({**known, **tables}))


def _given(value: Any) -> Any:
    """Return a value without the entries of its tables that are None."""
    if isinstance(value, Mapping):
        return {key: _given(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_given(inner) for inner in value]
    return value


def proposed_campaign(diameters: "Iterable[Diameter]", mechanism: str, name: str) -> str:
    """Return the text of a campaign file that varies diameters of a mechanism file, whose path is relative to it."""
    variables = {
        diameter.parameter: {
            "target": f"parameters.{diameter.parameter}",
            "distribution": "normal",
            "nominal": round((diameter.lower + diameter.upper) / 2, 9),
            "tolerance": round((diameter.upper - diameter.lower) / 2, 9),
            "cpk": CPK,
        }
        for diameter in diameters
    }
    tables = {"format": 1, "name": name, "mechanism": mechanism, "samples": SAMPLES}
    return _HEAD + campaign_text(tables | ({"variables": variables} if variables else {}))
