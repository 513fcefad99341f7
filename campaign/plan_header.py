"""The file of a plan and its header: what the store needs, read without the models of mechanism and campaign.

A digest in the file covers every byte of it. Files of format 1, written by earlier versions, have none.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from campaign.errors import StoreError

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT = 2  # of plan.json
WITHOUT_DIGEST = 1  # the format before
TYPES = ("bool", "double", "int64", "string")  # of columns
_UNSEALED = "0" * 64  # stands for the digest while the digest is computed


@dataclass(frozen=True)
class PlanHeader:
    """What a plan says about its rows."""

    # Name and ten hexadecimal digits of a hash of the spec, the mechanism and the build that computes the rows.
    campaign_id: str
    title: str  # its name if it has none
    batches: tuple[tuple[int, int], ...]  # first sample and number of samples of each batch, by its number
    columns: list[dict[str, Any]]  # ``name``, ``type``, ``unit`` and ``nullable`` of each column of the table
    # Share of the samples simulated again with half the step; see `campaign.repeat_plan`.
    repeats: float = field(default=0.0, kw_only=True)

    @property
    def samples(self) -> int:
        """Number of planned samples."""
        return sum(self.batches[-1])

    @property
    def folder(self) -> str:
        """Name of the folder of the parts."""
        return "parts"

    @property
    def all_samples(self) -> int:
        """Number of samples of the campaign."""
        return self.samples

    @property
    def sealed_as(self) -> str:
        """Name of the table in the seals of its files."""
        return self.campaign_id

    def numbers_of(self, begin: int, end: int) -> list[int]:
        """Return the sample numbers of the rows ``begin`` to ``end - 1``."""
        return list(range(begin, end))

    def rows_before(self, end: int) -> int:
        """Return the number of rows whose sample number is below ``end``."""
        return end

    @cached_property
    def schema(self) -> "pa.Schema":
        """Arrow schema of every part: columns, units and campaign id."""
        import pyarrow as pa  # heavy; `status` of a campaign without rows does not need it

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


def seal_plan(content: Mapping[str, Any]) -> str:
    """Return the text of ``plan.json`` for a plan as plain data, without format and digest."""
    document = {"format": FORMAT, "sha256": _UNSEALED, **content}
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    return text.replace(_UNSEALED, _digest(text), 1)


def parse_plan(text: str) -> tuple[PlanHeader, dict[str, Any]]:
    """Read ``plan.json``: its checked header, and the document as written, which is not checked in format 1.

    Raises StoreError if the file has another format, or was changed after it was written.
    """
    try:
        document = json.loads(text)
        if document["format"] not in (FORMAT, WITHOUT_DIGEST):
            formats = f"{WITHOUT_DIGEST} and {FORMAT}"
            raise StoreError(f"plan.json has format {document['format']!r:.20}; this version reads {formats}")
        # a file of format 2 whose format was changed to 1, which has no digest, still has keys that format 1 never had
        if document["format"] == FORMAT or document.keys() & {"sha256", "row_build"}:
            _check_digest(text, document.get("sha256"))
        content = (document["campaign"], _title(document), _batches(document), _columns(document))
        header = PlanHeader(*content, repeats=_repeats(document))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise unreadable_plan(error) from error
    return header, document


def unreadable_plan(error: Exception) -> StoreError:
    """Return the error that says why ``plan.json`` cannot be read."""
    why = f"it lacks {error}" if isinstance(error, KeyError) else str(error) or type(error).__name__
    return StoreError(f"plan.json cannot be read: {why}; restore it, or run in a new store")


def changed_plan() -> StoreError:
    """Return the error that says that ``plan.json`` was changed after it was written."""
    return StoreError("plan.json was changed after it was written; restore it, or run in a new store")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _check_digest(text: str, stated: Any) -> None:
    """Refuse a text whose digest differs from the stated one."""
    if not isinstance(stated, str) or len(stated) != len(_UNSEALED):
        raise changed_plan()
    if _digest(text.replace(stated, _UNSEALED, 1)) != stated:
        raise changed_plan()


def _title(document: Mapping[str, Any]) -> str:
    spec = document["spec"]
    title: str = spec.get("title") or spec["name"]
    f"{title}{document['campaign']}".encode()  # ValueError if they cannot be encoded
    if not isinstance(title, str) or not isinstance(document["campaign"], str):
        raise ValueError("its title or its id is not a text")
    return title


def _batches(document: Mapping[str, Any]) -> tuple[tuple[int, int], ...]:
    """Return the batches of a plan after checking that they hold each of its samples once and in order."""
    batches, samples = tuple((first, count) for first, count in document["batches"]), document["spec"]["samples"]
    if not all(type(number) is int for number in (samples, *(n for batch in batches for n in batch))):
        raise ValueError("a number of samples is not a whole number")
    expected = 0
    for first, count in batches:
        if first != expected or count < 1:
            raise ValueError(f"a batch begins at sample {first} in place of {expected}")
        expected += count
    if expected != samples or samples < 1:
        raise ValueError(f"its batches hold {expected} samples, but its spec asks for {samples}")
    return batches


def _columns(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the columns of a plan's table after checking the entries of each."""
    columns: list[dict[str, Any]] = document["schema"]
    for column in columns:
        named = isinstance(column["name"], str) and isinstance(column["unit"], str)
        if not named or column["type"] not in TYPES or not isinstance(column["nullable"], bool):
            raise ValueError(f"its table has a column {column['name']!r:.40} of unknown type")
    return columns


def _repeats(document: Mapping[str, Any]) -> float:
    """Return the share of the samples that a plan repeats; plans of earlier versions repeat none."""
    share = document.get("repeats", 0.0)
    if not isinstance(share, float | int) or isinstance(share, bool) or not 0.0 <= share <= 1.0:
        raise ValueError(f"it repeats a share of {share!r:.20} of its samples")
    return float(share)
