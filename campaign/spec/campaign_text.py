"""A campaign as the text of its file, from its tables: what a form has filled in, or a program has made."""

from collections.abc import Mapping
from typing import Any

from campaign.spec.campaign_file import CampaignSpec


def campaign_text(tables: Mapping[str, Any]) -> str:
    """Return the text of a campaign file.

    Parameters
    ----------
    tables : mapping
        The tables of the file as Python data, sound or not; what is None is left out.

    Returns
    -------
    str
        TOML with the keys at the top in reading order: format, name, mechanism, ..., variables, responses. Inside a
        table they keep their order. It has the same values as the tables.

    Raises
    ------
    TypeError
        If something in the tables is no TOML.
    """
    import tomli_w

    known = {key: tables[key] for key in CampaignSpec.model_fields if key in tables}
    return tomli_w.dumps(_given({**known, **tables}))


def _given(value: Any) -> Any:
    """Return a value without what is None in its tables."""
    if isinstance(value, Mapping):
        return {key: _given(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_given(inner) for inner in value]
    return value
