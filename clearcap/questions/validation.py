"""Measured parts against a campaign: whether its samples predict them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.store import Store, open_store
from clearcap.questions.measured import asked_of_parts, read_parts
from clearcap.questions.report import report_rows, report_spec
from reporting import ReportError
from reporting.comparison import Validation, validation
from reporting.samples import read_samples

if TYPE_CHECKING:
    import pandas as pd


def validate_campaign(
    parts: "str | Path | pd.DataFrame",
    campaign_id: str | None = None,
    store: str | Path = "runs",
    limits: Any = None,
) -> Validation:
    """Return how measured parts compare with the samples of a campaign.

    Parameters
    ----------
    parts : str, Path or pandas.DataFrame
        The measurements, one row a part: a CSV, Parquet or Excel file, or a table. Without `limits`, columns with the
        name of a response are compared, in the unit of the response.
    campaign_id : str, optional
        Id of the campaign; not needed if the store holds only one.
    store : str or Path
        Folder or URL of the store.
    limits : str, Path or mapping, optional
        Limits file of the parts, whose characteristics have the names of responses; it may name columns and lots.

    Returns
    -------
    Validation
        A prediction for each response, with its verdict, and the correlations.

    Raises
    ------
    SpecError
        The table or the limits do not fit the campaign.
    """
    opened = open_store(str(store))
    return validated(opened, opened.plan(opened.find(campaign_id)), parts, limits)


def validated(store: Store, plan: Plan, parts: "str | Path | pd.DataFrame", limits: Any = None) -> Validation:
    """Return what `validate_campaign` returns, of an open store."""
    spec = report_spec(plan, store)
    if limits is None:
        frame = read_parts(parts) if isinstance(parts, str | Path) else parts
        there = {str(column) for column in frame.columns}
        named = {each.name: {"unit": each.unit} for each in spec.responses if each.name in there}
        if not named:
            names = ", ".join(each.name for each in spec.responses)
            raise SpecError(
                f"parts: no column has the name of a response; rename the columns, or give --limits: {names}"
            )
        limits = {"characteristics": named}
    table, of_parts = asked_of_parts(parts, limits)
    try:
        samples = read_samples(report_rows(store, plan), spec)
        return validation(read_samples(table, of_parts), of_parts, samples, spec)
    except ReportError as error:
        raise SpecError(str(error)) from error
