"""The file of a plan, its header and its repeats: what the store needs, without the models of mechanism and campaign.

A digest in the file covers every byte of it. Earlier versions wrote format 2, which lists the batches, and format 1,
which has no digest besides.
"""

import hashlib
import json
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from campaign.batches import Batches, Span, as_rule
from campaign.errors import FailedStatus, StoreError

if TYPE_CHECKING:
    import pyarrow as pa

PARTS = "parts"  # folder of the rows; repeats have others
FORMAT = 3  # of plan.json
LISTED = 2  # the format before, which lists the batches
WITHOUT_DIGEST = 1  # the one before that
TYPES = ("bool", "double", "int64", "string")  # of columns
_UNSEALED = "0" * 64  # stands for the digest while the digest is computed
SETTINGS = "repeated_with"  # column of a repeat: the settings that differ from those of its row
_GOLDEN = 0x9E3779B97F4A7C15  # 2^64 over the golden ratio
_HALF = 0x4F1BBCDCBFA53E0A  # half of it: the place of sample 0
_BLOCK = 1 << 20  # samples processed together
_SPARSE = 1e-3  # share below which it takes less time to go from one repeat to the next
USUAL_SHARE, LARGEST_USUAL = 0.03, 0.05  # of the samples; a repeat takes about twice the time of its run
WANTED, ENOUGH = 20, 300  # repeats: they give the variance of a difference to within a third and a twelfth


@dataclass(frozen=True)
class PlanHeader:
    """What a plan says about its rows."""

    # Name and ten hexadecimal digits of a hash of the spec, the mechanism and the build that computes the rows.
    campaign_id: str
    title: str  # its name if it has none
    batches: Sequence[Span]  # first sample and number of samples of each batch, by its number
    columns: list[dict[str, Any]]  # ``name``, ``type``, ``unit`` and ``nullable`` of each column of the table
    # Share of the samples simulated again with half the step; see `repeated_samples`.
    repeats: float = field(default=0.0, kw_only=True)
    # Whether samples that cannot be assembled are a result with a limit of their own, and no failures.
    judges_unfit: bool = field(default=False, kw_only=True)
    folder: str = field(default=PARTS, kw_only=True)  # of the parts

    def is_failed(self, status: str) -> bool:
        """Return whether a row of a status counts as failed."""
        return status != "ok" and not (self.judges_unfit and status == FailedStatus.NOT_ASSEMBLABLE)

    def failed(self, statuses: Mapping[str, int]) -> int:
        """Return how many rows count as failed, from the number of rows by status."""
        return sum(count for status, count in statuses.items() if self.is_failed(status))

    @property
    def samples(self) -> int:
        """Number of planned samples."""
        return sum(self.batches[-1])

    @property
    def all_samples(self) -> int:
        """Number of samples of the campaign."""
        return self.samples

    @property
    def sealed_as(self) -> str:
        """Name of the table in the seals of its files."""
        return self.campaign_id if self.folder == PARTS else f"{self.campaign_id}/{self.folder}"

    def numbers_of(self, begin: int, end: int) -> list[int]:
        """Return the sample numbers of the rows ``begin`` to ``end - 1``."""
        return list(range(begin, end))

    def rows_before(self, end: int) -> int:
        """Return the number of rows whose sample number is below ``end``."""
        return end

    def batches_before(self, end: int) -> int:
        """Return the number of batches that begin before row ``end``."""
        if isinstance(self.batches, Batches):
            return min(self.batches.batch_of(max(end, 0) - 1) + 1, len(self.batches))
        return bisect_left(self.batches, end, key=itemgetter(0))

    def batch_numbers(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the number of the batch that holds each row, (n,)."""
        if isinstance(self.batches, Batches):
            return rows // self.batches.size
        return np.searchsorted([first for first, _ in self.batches], rows, side="right") - 1

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
    """Read ``plan.json``: its checked header, and the document as written, which is not checked in format 1."""
    try:
        document = json.loads(text)
        if document["format"] not in (FORMAT, LISTED, WITHOUT_DIGEST):
            formats = f"{WITHOUT_DIGEST} to {FORMAT}"
            raise StoreError(f"plan.json has format {document['format']!r:.20}; this version reads {formats}")
        # a file whose format was changed to 1, which has no digest, still has keys that format 1 never had
        if document["format"] != WITHOUT_DIGEST or document.keys() & {"sha256", "row_build", "batch_size"}:
            stated = document.get("sha256")
            if not isinstance(stated, str) or len(stated) != len(_UNSEALED):
                raise changed_plan()
            if _digest(text.replace(stated, _UNSEALED, 1)) != stated:
                raise changed_plan()
        content = (document["campaign"], _title(document), _batches(document), _columns(document))
        judges_unfit = document["spec"].get("failures", {}).get("max_not_assemblable") is not None
        header = PlanHeader(*content, repeats=_repeats(document), judges_unfit=judges_unfit)
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


def _title(document: Mapping[str, Any]) -> str:
    spec = document["spec"]
    title: str = spec.get("title") or spec["name"]
    f"{title}{document['campaign']}".encode()  # ValueError if they cannot be encoded
    if not isinstance(title, str) or not isinstance(document["campaign"], str):
        raise ValueError("its title or its id is not a text")
    return title


def _batches(document: Mapping[str, Any]) -> Batches | tuple[Span, ...]:
    """Return the batches of a plan after checking that they hold each of its samples once and in order."""
    samples = document["spec"]["samples"]
    if "batch_size" in document:
        _refuse_fractions(samples, document["batch_size"])
        return Batches(samples, document["batch_size"])
    batches = tuple((first, count) for first, count in document["batches"])
    _refuse_fractions(samples, *(n for batch in batches for n in batch))
    expected = 0
    for first, count in batches:
        if first != expected or count < 1:
            raise ValueError(f"a batch begins at sample {first} in place of {expected}")
        expected += count
    if expected != samples or samples < 1:
        raise ValueError(f"its batches hold {expected} samples, but its spec asks for {samples}")
    return as_rule(batches)


def _refuse_fractions(*numbers: Any) -> None:
    if not all(type(number) is int for number in numbers):
        raise ValueError("a number of samples is not a whole number")


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


# -- repeats -----------------------------------------------------------------------------------------------------------
#
# Some samples are simulated a second time with half the step; files of their own hold these rows. A sample is repeated
# if its value in a fixed sequence lies below the share to repeat. The sequence, multiples of the golden ratio modulo 1,
# fills the interval from 0 to 1 evenly from the first sample on and is in step with no sampler. So the first samples of
# a campaign, however many, include their share of repeats, and a larger share or more samples keep the repeats that
# already exist.


def usual_share(samples: int) -> float:
    """Return the share of its samples that a campaign repeats: 3 %, up to 5 % to get twenty, 300 at most."""
    return min(max(USUAL_SHARE, min(WANTED / samples, LARGEST_USUAL)), ENOUGH / samples)


def repeated_samples(samples: int, low: float, high: float) -> NDArray[np.int64]:
    """Return, in order, the samples below ``samples`` that a share ``high`` repeats and a share ``low`` does not."""
    found = [np.zeros(0, np.int64)]
    for first in range(0, samples, _BLOCK) if high > low else ():
        sample = np.arange(first, min(first + _BLOCK, samples), dtype=np.uint64)
        # 53 bits, which a float holds exactly
        place = ((sample * np.uint64(_GOLDEN) + np.uint64(_HALF)) >> np.uint64(11)) * 2.0**-53
        found.append(sample[(place >= low) & (place < high)].astype(np.int64))
        if high - low < _SPARSE and found[-1].size:
            return np.fromiter(_repeated_from(int(found[-1][0]), samples, low, high), np.int64)
    return np.concatenate(found)


def _repeated_from(sample: int, samples: int, low: float, high: float) -> Iterator[int]:
    """Yield a repeated sample, and those after it."""
    # From one to the next it is as far as to the first sample whose place is less than the length of the interval ahead
    # of the place of sample 0, or behind it, or as far as both together (three-distance theorem). Places are integers,
    # of 2^64.
    begin, end = (ceil(share * 2.0**53) << 11 for share in (low, high))
    length, ahead, behind, to_ahead, to_behind = end - begin, _GOLDEN, 2**64 - _GOLDEN, 1, 1
    while max(ahead, behind) >= length:
        if ahead > behind:
            ahead, to_ahead = ahead - behind, to_ahead + to_behind
        else:
            behind, to_behind = behind - ahead, to_behind + to_ahead
    at = (sample * _GOLDEN + _HALF) % 2**64 - begin
    while sample < samples:
        yield sample
        if at + ahead < length:
            at, sample = at + ahead, sample + to_ahead
        elif at >= behind:
            at, sample = at - behind, sample + to_behind
        else:
            at, sample = at + ahead - behind, sample + to_ahead + to_behind


@dataclass(frozen=True)
class RepeatPlan(PlanHeader):
    """A set of repeats, which the store treats as a campaign's table in a folder of its own.

    Each of its batches holds the repeats of one batch of the campaign; batches without a repeat are left out. Rows are
    counted from 0 as in a campaign, but their sample numbers are not successive.
    """

    campaign: PlanHeader  # whose samples are repeated
    numbers: tuple[int, ...]  # sample of each row, in order
    campaign_batches: tuple[int, ...]  # batch of the campaign that each batch repeats

    @property
    def all_samples(self) -> int:
        """Number of samples of the campaign."""
        return self.campaign.samples

    def numbers_of(self, begin: int, end: int) -> list[int]:
        """Return the sample numbers of the rows ``begin`` to ``end - 1``."""
        return list(self.numbers[begin:end])

    def rows_before(self, end: int) -> int:
        """Return the number of rows that repeat samples below ``end``."""
        return bisect_left(self.numbers, end)

    def batch_of(self, campaign_batch: int) -> int | None:
        """Return the batch that repeats samples of a campaign's batch; None if none of its samples is repeated."""
        at = bisect_left(self.campaign_batches, campaign_batch)
        return at if self.campaign_batches[at : at + 1] == (campaign_batch,) else None


def plan_repeats(campaign: PlanHeader, shares: Sequence[float]) -> tuple[RepeatPlan, ...]:
    """Return the sets of repeats that rising shares of the samples add, each to the one before; empty ones left out."""
    columns = [*campaign.columns, {"name": SETTINGS, "type": "string", "unit": "", "nullable": False}]
    plans = []
    for number, (low, high) in enumerate(zip((0.0, *shares), shares, strict=False), 1):
        numbers = repeated_samples(campaign.samples, low, high)
        of_batches, begins = np.unique(campaign.batch_numbers(numbers), return_index=True)
        batches = tuple(zip(begins.tolist(), np.diff(begins, append=numbers.size).tolist(), strict=True))
        if batches:
            header = (campaign.campaign_id, campaign.title, batches, columns)
            rows = (campaign, tuple(numbers.tolist()), tuple(of_batches.tolist()))
            plans.append(RepeatPlan(*header, *rows, folder=f"repeats-{number}"))
    return tuple(plans)
