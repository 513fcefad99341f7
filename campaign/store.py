"""The store of campaigns: files are the truth about what has been computed.

STORE/CAMPAIGN_ID/campaign.toml   the spec
                  plan.json       the plan, immutable
                  parts/part-000123.parquet   the rows of batch 123, whole or not there
                  report/         what reporting wrote
"""

import io
import logging
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w

from campaign.errors import SpecError, StoreError
from campaign.files import Files
from campaign.plan import Plan, dump

logger = logging.getLogger(__name__)


class BadPart(Exception):
    """A part that is not what its name says; the message says why."""


@dataclass(frozen=True)
class Scan:
    """What a store holds of a plan.

    Attributes
    ----------
    table : pyarrow.Table
        The rows there are, sorted by sample.
    missing : list of int
        Batches without a sound part.
    bad : dict of int to str
        Those of them that have a part, and what is wrong with it.
    """

    table: pa.Table
    missing: list[int]
    bad: dict[int, str]


class Store:
    """Campaigns under one folder or URL; see the module's text for the layout."""

    def __init__(self, files: Files) -> None:
        self.files = files

    @property
    def url(self) -> str:
        """What the store was opened with."""
        return self.files.url

    def campaigns(self) -> list[str]:
        """Return the ids of all campaigns, sorted."""
        return [name for name in self.files.names("") if self.files.exists(f"{name}/plan.json")]

    def find(self, campaign_id: str | None) -> str:
        """Return the id of the campaign meant: the one named, or the only one there is.

        Raises
        ------
        SpecError
            If there is no such campaign, or no id was given and there are several.
        """
        known = self.campaigns()
        there = f"campaigns there: {', '.join(known) or 'none'}"
        if campaign_id is None and len(known) != 1:
            raise SpecError(f"store {self.url}: say which campaign; {there}")
        if campaign_id is not None and campaign_id not in known:
            raise SpecError(f"store {self.url}: no campaign {campaign_id}; {there}")
        return campaign_id or known[0]

    def create_plan(self, plan: Plan) -> Plan:
        """Put a plan into the store, unless it is there already; return the one that is there then."""
        name = f"{plan.campaign_id}/plan.json"
        if not self.files.exists(name):
            spec = tomli_w.dumps(dump(plan.spec))
            self.files.write(f"{plan.campaign_id}/campaign.toml", spec.encode())
            self.files.write(name, plan.to_json().encode(), exclusive=True)
        return self.plan(plan.campaign_id)

    def plan(self, campaign_id: str) -> Plan:
        """Read a campaign's plan."""
        try:
            text = self.files.read(f"{campaign_id}/plan.json").decode()
            plan = Plan.from_json(text)
        except (FileNotFoundError, UnicodeDecodeError, StoreError) as error:
            raise StoreError(f"store {self.url}, campaign {campaign_id}: {error}") from error
        if plan.campaign_id != campaign_id:
            raise StoreError(f"store {self.url}: folder {campaign_id} holds the plan of {plan.campaign_id}")
        return plan

    def write_part(self, plan: Plan, batch: int, table: pa.Table) -> None:
        """Write the rows of a batch; ``table`` has the plan's schema."""
        buffer = io.BytesIO()
        pq.write_table(table.cast(plan.schema), buffer, compression="zstd", write_page_checksum=True)
        self.files.write(part_name(plan, batch), buffer.getvalue())

    def read_part(self, plan: Plan, batch: int) -> pa.Table:
        """Read the rows of a batch.

        Raises
        ------
        FileNotFoundError
            If the batch has no part.
        BadPart
            If the part is truncated, damaged, or from elsewhere.
        """
        content = self.files.read(part_name(plan, batch))
        try:
            table = pq.read_table(pa.BufferReader(content), page_checksum_verification=True)
        except (pa.ArrowException, OSError) as error:
            raise BadPart(f"not a whole Parquet file ({str(error).splitlines()[0]})") from error
        origin = (table.schema.metadata or {}).get(b"campaign", b"none").decode(errors="replace")
        if origin != plan.campaign_id:
            raise BadPart(f"belongs to campaign {origin}")
        if not table.schema.equals(plan.schema, check_metadata=True):
            raise BadPart("has other columns or units than the plan")
        first, count = plan.batches[batch]
        if table["sample"].to_pylist() != list(range(first, first + count)):
            raise BadPart(f"does not hold exactly the samples {first} to {first + count - 1}")
        return table

    def scan(self, plan: Plan) -> Scan:
        """Read everything there is of a plan."""
        present = _batch_numbers(self.files.names(f"{plan.campaign_id}/parts"))
        tables, missing, bad = [plan.schema.empty_table()], [], {}
        for batch in range(len(plan.batches)):
            try:
                if batch not in present:
                    raise FileNotFoundError
                tables.append(self.read_part(plan, batch))
            except FileNotFoundError:
                missing.append(batch)
            except BadPart as error:
                missing.append(batch)
                bad[batch] = str(error)
        return Scan(pa.concat_tables(tables).combine_chunks(), missing, bad)

    def set_aside(self, plan: Plan, scan: Scan) -> None:
        """Rename the bad parts of a scan to ``.bad``, so that they are computed again, and say so."""
        for batch, reason in scan.bad.items():
            name = part_name(plan, batch)
            self.files.rename(name, f"{name}.bad")
            logger.warning("%s %s: set aside as %s.bad and computed again", name, reason, name.rsplit("/")[-1])

    def table(self, campaign_id: str | None = None) -> pa.Table:
        """Return the rows of a campaign, sorted by sample.

        Parameters
        ----------
        campaign_id : str, optional
            Which; not needed when the store holds only one.

        Returns
        -------
        pyarrow.Table
            The rows there are: one a sample, units in the field metadata. Bad parts are logged and left out.
        """
        plan = self.plan(self.find(campaign_id))
        scan = self.scan(plan)
        warn_of_bad_parts(plan, scan)
        return scan.table


def open_store(url: str) -> Store:
    """Open a store by the path of a folder or by an fsspec URL; nothing is read or written yet."""
    return Store(Files(url))


def part_name(plan: Plan, batch: int) -> str:
    """Return the name of a batch's part, relative to the store."""
    return f"{plan.campaign_id}/parts/part-{batch:06d}.parquet"


def count_statuses(scan: Scan) -> dict[str, int]:
    """Return how many rows of a scan have which status."""
    return dict(sorted(Counter(scan.table["status"].to_pylist()).items()))


def warn_of_bad_parts(plan: Plan, scan: Scan) -> None:
    """Say which parts a reader leaves out."""
    for batch, reason in scan.bad.items():
        logger.warning("%s %s: left out; run the campaign again to replace it", part_name(plan, batch), reason)


def _batch_numbers(names: Sequence[str]) -> set[int]:
    matches = (re.fullmatch(r"part-(\d{6,})\.parquet", name) for name in names)
    return {int(match[1]) for match in matches if match}
