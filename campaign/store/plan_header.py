"""The outline of a plan: what counting rows takes, without the models of mechanism and campaign."""

import json
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from campaign.errors import StoreError

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class Outline:
    """What a plan says about its rows.

    Attributes
    ----------
    campaign_id : str
        Whose.
    title : str
        Of the campaign, or its name.
    batches : tuple of (int, int)
        First sample and number of samples of each batch.
    columns : list of dict
        Name, type, unit and whether it may be null, of each column.
    """

    campaign_id: str
    title: str
    batches: tuple[tuple[int, int], ...]
    columns: list[dict[str, Any]]

    @property
    def samples(self) -> int:
        """How many samples were asked for."""
        return sum(self.batches[-1])

    @cached_property
    def schema(self) -> "pa.Schema":
        """Columns, units and campaign id of every part, as the plan has them."""
        import pyarrow as pa

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


def read_outline(text: str) -> Outline:
    """Return the outline of the plan in ``plan.json``.

    Raises
    ------
    StoreError
        If it is not what was written, as far as that can be seen here.
    """
    try:
        content = json.loads(text)
        spec = content["spec"]
        batches = tuple((int(first), int(count)) for first, count in content["batches"])
        outline = Outline(content["campaign"], spec.get("title") or spec["name"], batches, content["schema"])
        expected = 0
        for first, count in batches:
            if first != expected or count < 1:
                raise ValueError(f"a batch begins at sample {first} where {expected} is next")
            expected += count
        if expected != spec["samples"]:
            raise ValueError(f"its batches hold {expected} samples and its spec asks for {spec['samples']}")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise StoreError(f"plan.json cannot be read: {error}; restore it, or run in a new store") from error
    return outline
