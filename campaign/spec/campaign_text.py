"""Write the text of a campaign file from its tables, which a form or a program has filled in."""

from collections.abc import Mapping
from typing import Any

from campaign.spec.campaign_file import CampaignSpec


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
    import tomli_w

    known = {key: tables[key] for key in CampaignSpec.model_fields if key in tables}
    return tomli_w.dumps(_given({**known, **tables}))


def _given(value: Any) -> Any:
    """Return a value without the entries of its tables that are None."""
    if isinstance(value, Mapping):
        return {key: _given(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_given(inner) for inner in value]
    return value
