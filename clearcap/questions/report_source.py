"""What a report was made of: the digests of plan and rows, which it states among its provenance.

The rows of the aimed campaigns that decide what the samples leave open belong to them. Where files are listed for a
campaign, theirs are in a folder of their own, `DECIDING`.

So a report that is not of the rows beside it is found without the server; one that was edited by hand is found by
writing it again (`clearcap.questions.report.report_again`).
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.plan_header import PlanHeader
from campaign.store import Store
from campaign.store.layout import DECISION, PLAN, REPEATS, STOPPED
from campaign.store.store import repeat_plans
from reporting.write import NAMES

OF_PLAN, OF_ROWS = "plan digest", "rows digest"  # names in the provenance of a report
_DATE = re.compile(r"\d{4}-\d{2}-\d{2} \d{2}:\d{2} UTC")
DOCUMENTS = (STOPPED, REPEATS, DECISION)  # they say which rows belong to the table, and which decide
DECIDING = "deciding"
Stage = tuple[Plan, tuple[str, ...]]  # an aimed campaign, and the responses that it decides


def canonical(content: Any) -> bytes:
    """Return plain data as canonical JSON for signing: sorted keys, no spaces, UTF-8."""
    return json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()


def sha256(content: bytes) -> str:
    """Return a SHA-256 as 64 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def deciding_campaigns(store: Store, campaign: str) -> dict[str, list[str]]:
    """Return the responses that each aimed campaign decides, by its id; in their order, up to one that is missing."""
    stages = (store.read_json(campaign, DECISION) or {}).get("stages")
    found: dict[str, list[str]] = {}
    for stage in stages if isinstance(stages, list) else ():
        match stage:
            case {"campaign": str(decides), "responses": list(names)} if decides in store.campaigns():
                found[decides] = names
            case _:
                break
    return found


def decided_by(store: Store, plan: Plan) -> tuple[Stage, ...]:
    """Return the aimed campaigns that decide what a campaign leaves open, each with these responses, in their order."""
    return tuple(
        (store.plan(decides), tuple(name for name in plan.mechanism.responses if name in names))
        for decides, names in deciding_campaigns(store, plan.campaign_id).items()
    )


def stored_at(campaign: str, name: str) -> str:
    """Return where the store has a file that is listed for a campaign."""
    return name.removeprefix(f"{DECIDING}/") if name.startswith(f"{DECIDING}/") else f"{campaign}/{name}"


def tables_of(store: Store, header: PlanHeader) -> Iterator[tuple[str, PlanHeader]]:
    """Yield the tables of which a report is made, each with the folder, as listed, in which its campaign is."""
    yield from (("", table) for table in (header, *repeat_plans(store, header)))
    for deciding in deciding_campaigns(store, header.campaign_id):
        yield f"{DECIDING}/{deciding}/", store.plan_header(deciding)


def documents_of(store: Store, header: PlanHeader) -> list[str]:
    """Return the names of the documents on the tables of a report."""
    campaign = header.campaign_id
    names = [name for name in DOCUMENTS if store.files.exists(f"{campaign}/{name}")]
    return names + [f"{where}{PLAN}" for where, _ in tables_of(store, header) if where]


def report_source(store: Store, header: PlanHeader) -> dict[str, str]:
    """Return the digests of a campaign's plan and rows, as its report states them; no file of rows is read."""
    campaign = header.campaign_id
    documents = {name: store.files.read(stored_at(campaign, name)) for name in documents_of(store, header)}
    seals = {
        f"{where}{table.folder}/{part.file}": part.sha256
        for where, table in tables_of(store, header)
        for part in store.survey(table).parts.values()
    }
    return source_digests(store.files.read(f"{campaign}/{PLAN}"), documents, seals)


def source_digests(plan: bytes, documents: Mapping[str, bytes], seals: Mapping[str, str]) -> dict[str, str]:
    """Return the digests that a report states; ``seals`` are those in the seals of the files of rows, by name."""
    rows = {**seals, **{name: sha256(content) for name, content in documents.items()}}
    return {OF_PLAN: sha256(plan), OF_ROWS: sha256(canonical(rows))}


def stated_source(document: bytes) -> dict[str, str] | None:
    """Return the digests that the JSON of a report states; None if it states none, as before they were written."""
    provenance = _document(document).get("provenance")
    if not isinstance(provenance, dict):
        raise CampaignError(f"{NAMES['json']}: is not the JSON of a report; write the report again")
    stated = {name: provenance[name] for name in (OF_PLAN, OF_ROWS) if isinstance(provenance.get(name), str)}
    return stated or None


def stated_date(document: bytes) -> str:
    """Return the date that the JSON of a report states; CampaignError if it states none."""
    written = _document(document).get("written")
    if not (isinstance(written, str) and _DATE.fullmatch(written)):
        raise CampaignError(f"{NAMES['json']}: written is not a date; write the report again")
    return written


def _document(content: bytes) -> dict[str, Any]:
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        document = None
    return document if isinstance(document, dict) else {}
