"""The header of a plan: what the store must know of it, read without the models of mechanism and campaign."""

import json
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from campaign.errors import StoreError

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT = 1  # of plan.json


@dataclass(frozen=True)
class PlanHeader:
    """What a plan says about its rows.

    Attributes
    ----------
    campaign_id : str
        Name and ten hexadecimal digits of a hash over spec, mechanism and engine build.
    title : str
        Title of the campaign; its name if it has none.
    batches : tuple of (int, int)
        First sample and number of samples of each batch; the position in the tuple is the batch number.
    columns : list of dict
        Name, type, unit and whether it may be null, of each column of the table.
    """

    campaign_id: str
    title: str
    batches: tuple[tuple[int, int], ...]
    columns: list[dict[str, Any]]

    @property
    def samples(self) -> int:
        """Number of samples that are planned."""
        return sum(self.batches[-1])

    @cached_property
    def schema(self) -> "pa.Schema":
        """Arrow schema of every part: columns, units and campaign id."""
        import pyarrow as pa  # `status` of a campaign without rows does without

        fields = [
            pa.field(
                column["name"],
                pa.type_for_alias(column["type"]),
                nullable=column["nullable"],
                metadata={"unit": column["unit"]} if column["unit"] else None,
            )
            for column in self.columns
        ]
        return pa.schema(fields, metadata={"format": "1", "campaign": self.campaign_id})


def parse_plan(text: str) -> tuple[PlanHeader, dict[str, Any]]:
    """Read ``plan.json``: its header, and the whole document.

    Parameters
    ----------
    text : str
        Content of the file.

    Returns
    -------
    (PlanHeader, dict)
        The header, checked; and the document, of which nothing else is checked.

    Raises
    ------
    StoreError
        If it is of another format, or damaged as far as the header shows it.
    """
    try:
        document = json.loads(text)
        if document["format"] != FORMAT:
            raise StoreError(f"plan.json has format {document['format']}; this version reads {FORMAT}")
        spec = document["spec"]
        batches = tuple((int(first), int(count)) for first, count in document["batches"])
        header = PlanHeader(document["campaign"], spec.get("title") or spec["name"], batches, document["schema"])
        expected = 0
        for first, count in batches:
            if first != expected or count < 1:
                raise ValueError(f"a batch begins at sample {first} in place of {expected}")
            expected += count
        if expected != spec["samples"]:
            raise ValueError(f"its batches hold {expected} samples, but its spec asks for {spec['samples']}")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise unreadable_plan(error) from error
    return header, document


def unreadable_plan(error: Exception) -> StoreError:
    """Return the error that says why ``plan.json`` cannot be read."""
    return StoreError(f"plan.json cannot be read: {error}; restore it, or run in a new store")
