"""The store: plans, parts, tables, small documents and reports of campaigns under one root, and what has changed."""

import hashlib
import json
import os
import re
import stat
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

from campaign.errors import SpecError, StoreError
from campaign.plan_header import PlanHeader, RepeatPlan, parse_plan, plan_repeats
from campaign.store.files.files import TEMPORARY, Files
from campaign.store.files.retry_policy import PATIENT, RetryPolicy
from campaign.store.layout import (
    CAMPAIGN_FILE,
    COMPARISONS,
    DECISION,
    HEARTBEAT,
    LOG,
    PLAN,
    POOLED,
    REPEATS,
    REPORT,
    STOPPED,
)
from campaign.store.manifest import record_parts
from campaign.store.parts import Part, check, encode, part_name, read_part_file, total
from campaign.store.rows import Compacted, compact, quarantine, read_batch, stream
from campaign.store.survey import Survey, survey

if TYPE_CHECKING:
    import pyarrow as pa

    from campaign.plan import Plan


LARGEST_DOCUMENT = 2**20  # bytes: a thousand times what a state, a lease or a heartbeat takes
P = TypeVar("P", bound=PlanHeader)
_IRRELEVANT = (HEARTBEAT, LOG)  # to a change token
MOST_SETS = 20
MOST_LISTED = 10  # ids in a message
_CAMPAIGN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")


class Store:
    """Campaigns under one folder or URL; see `campaign.store.layout` for the files."""

    def __init__(self, files: Files) -> None:
        self.files = files

    @property
    def url(self) -> str:
        """Folder or URL that the store was opened with, without passwords, so that it may be shown."""
        return self.files.url

    @property
    def hasty(self) -> "Store":
        """The same store for callers that must not wait: each operation is tried only once."""
        return Store(self.files.hasty)

    # -- campaigns ---------------------------------------------------------------------------------------------------

    def campaigns(self) -> list[str]:
        """Return the ids of all campaigns, sorted."""
        return [name for name in self.folders() if self.files.exists(f"{name}/{PLAN}")]

    def folders(self) -> list[str]:
        """Return the names of all folders that could be a campaign's, sorted."""
        return folders_of_campaigns(self.files.names(""))

    def command(self, verb: str, *words: str) -> str:
        """Return a complete command on this store; see `Files.command`."""
        return self.files.command(verb, *words)

    def find(self, campaign_id: str | None) -> str:
        """Return the full id of a campaign from its first letters; None means the only one. See `which_campaign`."""
        return which_campaign(self.files, self.campaigns(), campaign_id, self.decided_by)

    def decided_by(self, ids: Sequence[str]) -> list[str]:
        """Return the campaigns whose runs decide what these leave open."""
        found = []
        for each in ids:
            stages = (self.read_json(each, DECISION) or {}).get("stages")
            for stage in stages if isinstance(stages, list) else ():
                match stage:
                    case {"campaign": str(aimed)}:
                        found.append(aimed)
        return found

    def create_plan(self, plan: "Plan") -> "Plan":
        """Write a plan unless the store already has one of this id; return the plan that is in the store."""
        name = f"{plan.campaign_id}/{PLAN}"
        if not self.files.exists(name):
            import tomli_w

            from campaign.plan import dump_spec

            # before the plan: as soon as that is there, the store has the campaign
            self.files.write(f"{plan.campaign_id}/{CAMPAIGN_FILE}", tomli_w.dumps(dump_spec(plan.spec)).encode())
            self.files.create(name, plan.to_json().encode())
        # read back: another process may have been first, with other batches
        return self.plan(plan.campaign_id)

    def plan(self, campaign_id: str) -> "Plan":
        """Read a campaign's plan."""
        from campaign.plan import Plan  # loads the models of mechanism and campaign, which a header does not need

        return self._read_plan(campaign_id, Plan.from_json)

    def plan_header(self, campaign_id: str) -> PlanHeader:
        """Read the header of a plan, which is enough to count rows, in a hundredth of the time that `plan` takes."""
        return self._read_plan(campaign_id, lambda text: parse_plan(text)[0])

    def _read_plan(self, campaign_id: str, parse: Callable[[str], P]) -> P:
        """Read ``plan.json``, and check that it is in the folder of its own campaign."""
        try:
            plan = parse(self.files.read(f"{campaign_id}/{PLAN}", must_exist=True).decode())
        except FileNotFoundError as error:
            raise StoreError(f"store {self.url}: has no {campaign_id}/{PLAN}; it was deleted, or restore it") from error
        except (UnicodeDecodeError, StoreError) as error:
            raise StoreError(f"store {self.url}, campaign {campaign_id}: {error}") from error
        if plan.campaign_id != campaign_id:
            raise StoreError(f"store {self.url}: folder {campaign_id} holds the plan of {plan.campaign_id}")
        return plan

    # -- rows --------------------------------------------------------------------------------------------------------

    def write_part(self, plan: PlanHeader, batch: int, table: "pa.Table") -> Part:
        """Write the rows of a batch, in the plan's columns, replacing earlier ones."""
        content = encode(plan, table, batch, batch)
        self.files.write(part_name(plan, batch), content)
        return check(plan, content, batch, batch, merged=False)[0]

    def read_part(self, plan: PlanHeader, batch: int) -> "pa.Table":
        """Read the rows of a batch from its part or a merged file; FileNotFoundError, or BadPart if all are damaged."""
        return read_batch(self.files, plan, batch)

    def read_own_part(self, plan: PlanHeader, batch: int) -> "tuple[Part, pa.Table]":
        """Read the rows of a batch from its own part only; raises the same errors as `read_part`."""
        return read_part_file(self.files, plan, batch)

    def survey(self, plan: PlanHeader, verify: bool = False) -> Survey:
        """Return which parts and rows of a plan the store holds; ``verify`` reads all files, also the manifest's."""
        return survey(self.files, plan, self.end(plan), verify=verify)

    def record(self, plan: PlanHeader, parts: Iterable[Part], segments: Collection[int] | None = None) -> None:
        """Write the manifest, so that the next survey need not read these parts: all of a plan, or of some segments."""
        record_parts(self.files, plan, parts, segments)

    def quarantine(self, plan: PlanHeader, bad: Iterable[int]) -> list[str]:
        """Rename files of bad batches to ``.bad``, so that they are computed again; return the new names."""
        return quarantine(self.files, plan, bad)

    def compact(self, plan: PlanHeader) -> Compacted:
        """Merge the parts into files of about 100,000 rows; it may be killed and repeated at any time."""
        compacted = compact(self.files, plan)
        self.record(plan, compacted.parts.values())
        return compacted

    def end(self, plan: PlanHeader) -> int:
        """Return the number of rows in the table: all planned rows, unless the stopping rule ended the campaign."""
        stopped = self.read_json(plan.campaign_id, STOPPED)
        if stopped is None:
            return sum(plan.batches[-1])
        samples = plan.all_samples
        end = stopped.get("samples")
        if not isinstance(end, int) or isinstance(end, bool) or not 0 < end <= samples:
            raise StoreError(
                f"store {self.url}: {plan.campaign_id}/{STOPPED} says samples = {end!r}; allowed: 1 to {samples};"
                " restore it, or remove it to compute all samples"
            )
        return plan.rows_before(end)

    def stream(
        self, plan: PlanHeader, columns: Sequence[str] | None = None, batches: Collection[int] | None = None
    ) -> "Iterator[pa.Table]":
        """Yield rows in the order of the samples, ten thousand at a time; bad files are left out, with a warning."""
        return stream(self.files, plan, self.end(plan), columns, batches)

    def table(self, campaign_id: str | None = None) -> "pa.Table":
        """Return the rows of a campaign, sorted by sample.

        Parameters
        ----------
        campaign_id : str, optional
            Not needed if the store holds only one campaign.

        Returns
        -------
        pyarrow.Table
            One row per sample, with units in the field metadata. Bad parts are left out, with a warning.
        """
        import pyarrow as pa

        plan = self.plan(self.find(campaign_id))
        return pa.concat_tables([plan.schema.empty_table(), *self.stream(plan)]).combine_chunks()

    # -- small documents ---------------------------------------------------------------------------------------------

    def read_json(self, campaign_id: str, name: str, at_most: int = LARGEST_DOCUMENT) -> dict[str, Any] | None:
        """Return a document of a campaign; None if it does not exist, StoreError if it cannot be read."""
        path = f"{campaign_id}/{name}"
        try:
            content = json.loads(self.files.read(path, at_most))
        except FileNotFoundError:
            return None
        except (ValueError, RecursionError) as error:
            raise StoreError(f"store {self.url}: {path} is not JSON ({error}); restore or remove it") from error
        if not isinstance(content, dict):
            raise StoreError(f"store {self.url}: {path} does not hold a JSON object; restore or remove it")
        return content

    def write_json(self, campaign_id: str, name: str, content: dict[str, Any]) -> None:
        """Write a document of a campaign, whole or not at all, replacing an earlier one."""
        self.files.write(f"{campaign_id}/{name}", _json(content))

    def create_json(self, campaign_id: str, name: str, content: dict[str, Any]) -> bool:
        """Write a document of a campaign unless it exists; of several simultaneous writers, only one gets True."""
        # Behind a URL the content must name its writer, because two writers of the same content may both get True.
        return self.files.create(f"{campaign_id}/{name}", _json(content))

    def remove(self, campaign_id: str, name: str) -> None:
        """Remove a document of a campaign, if it exists."""
        self.files.remove(f"{campaign_id}/{name}")


def open_store(url: str, patience: RetryPolicy = PATIENT) -> Store:
    """Open a store; nothing is read or written yet.

    Parameters
    ----------
    url : str
        Path of a folder, or an fsspec URL.
    patience : RetryPolicy
        How long a failing operation is tried again.

    Raises
    ------
    SpecError
        If the URL names a file system that is not installed here.
    """
    return Store(Files(url, patience))


def _json(content: dict[str, Any]) -> bytes:
    return (json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


# -- which campaign is meant -------------------------------------------------------------------------------------------


def check_is_store(files: Files) -> None:
    """Raise SpecError unless the folder of a store exists and is not that of one campaign; a URL needs no folder."""
    if not files.local:
        return
    try:
        is_folder = stat.S_ISDIR(os.stat(files.full_url).st_mode)
    except (FileNotFoundError, NotADirectoryError):
        raise SpecError(
            f"store {files.url}: no such folder; name the folder of your results with --store, or make one:"
            f" {files.command('run', 'CAMPAIGN')}"
        ) from None
    except OSError:
        return  # reading it reports why it cannot be read
    if not is_folder:
        raise SpecError(f"store {files.url}: is a file, not a folder of campaigns; name the folder with --store")
    if files.exists(PLAN):
        parent, name = os.path.split(files.url.rstrip("/"))
        raise SpecError(
            f"store {files.url}: is the folder of one campaign, not a store; write {name} --store {parent or '.'}"
        )


def folders_of_campaigns(names: Iterable[str]) -> list[str]:
    """Return the names that are valid as the folder of a campaign, sorted."""
    return sorted(filter(_CAMPAIGN.fullmatch, names))


def which_campaign(
    files: Files,
    ids: Sequence[str],
    wanted: str | None,
    deciding: Callable[[Sequence[str]], Collection[str]] = lambda ids: (),
) -> str:
    """Return the id that a user means by it, by its first letters if no other begins so, or by None: the only one."""
    # Campaigns that only decide another one, as ``deciding`` tells of some ids, are meant only by their own names.
    check_is_store(files)
    if not ids:
        raise SpecError(f"store {files.url}: holds no campaign; make one: {files.command('run', 'CAMPAIGN')}")
    if wanted is not None and wanted in ids:
        return wanted
    matching = [each for each in ids if wanted is None or (wanted and each.startswith(wanted))]
    if 1 < len(matching) <= MOST_LISTED:
        aimed = deciding(matching)
        matching = [each for each in matching if each not in aimed] or matching
    if len(matching) == 1:
        return matching[0]
    if wanted is None:
        raise SpecError(f"store {files.url}: name the campaign; its campaigns: {_listed(files, ids)}")
    if matching:
        raise SpecError(
            f"store {files.url}: {wanted} could be several campaigns: {_listed(files, matching)}; write more of it"
        )
    raise SpecError(f"store {files.url}: no campaign {wanted or repr(wanted)}; its campaigns: {_listed(files, ids)}")


def _listed(files: Files, ids: Sequence[str]) -> str:
    others = len(ids) - MOST_LISTED
    return ", ".join(ids[:MOST_LISTED]) + (f" and {others} more, see: {files.command('list')}" if others > 0 else "")


# -- reports -----------------------------------------------------------------------------------------------------------


def report_folder(campaign_id: str, against: str | None = None) -> str:
    """Return the folder of a campaign's report, or of its comparison with another campaign, relative to the store."""
    return f"{campaign_id}/{REPORT}" if against is None else f"{campaign_id}/{COMPARISONS}/{against}"


def comparisons(store: Store, campaign_id: str) -> dict[str, list[str]]:
    """Return the names of the files of a campaign's comparisons, by the id of the other campaign, deleted or not."""
    return _reports_below(store, f"{campaign_id}/{COMPARISONS}")


def pools(store: Store, campaign_id: str) -> dict[str, list[str]]:
    """Return the names of the files of the reports in which a campaign comes first of several, by their folders."""
    return _reports_below(store, f"{campaign_id}/{POOLED}")


def _reports_below(store: Store, folder: str) -> dict[str, list[str]]:
    written = {name: store.files.names(f"{folder}/{name}") for name in store.files.names(folder)}
    whole = {each: [name for name in names if not name.endswith(TEMPORARY)] for each, names in written.items()}
    return {each: names for each, names in whole.items() if names}


# -- changes -----------------------------------------------------------------------------------------------------------
#
# Which campaigns have changed is detected by a token for each, computed from a listing without opening a file. The
# token of a campaign changes with its plan, state, lease, rows, repeats, labels, report and comparisons. Heartbeats and
# the log do not affect it, nor does damage to a file in place. A campaign whose state is ``running`` can end without
# any file changing, if its coordinator dies, so such campaigns must be observed
# (`campaign.coordinator.heartbeat.observe`).


def change_token(store: Store, campaign_id: str) -> str | None:
    """Return the token of one campaign, given by its full id; None if there is no such campaign."""
    stamps = store.files.stamps(campaign_id)
    if PLAN not in stamps:
        return None
    # a file written into a comparison changes the stamp of that comparison's own folder only
    if store.files.local and COMPARISONS in stamps:
        folder = f"{campaign_id}/{COMPARISONS}"
        stamps |= {f"{COMPARISONS}/{other}": stamp for other, stamp in store.files.stamps(folder).items()}
    return _token(stamps)


def change_tokens(store: Store) -> dict[str, str]:
    """Return the token of each campaign of a store, by id."""
    # In a folder this takes one listing per campaign and one stat of each of its files, on S3 one request per thousand
    # files of the store.
    if store.files.local:
        tokens = {name: change_token(store, name) for name in store.folders()}
        return {name: token for name, token in tokens.items() if token is not None}
    by_folder: defaultdict[str, dict[str, str]] = defaultdict(dict)
    for path, stamp in store.files.stamps("").items():
        folder, _, name = path.partition("/")
        by_folder[folder][name] = stamp
    return {name: _token(by_folder[name]) for name in folders_of_campaigns(by_folder) if PLAN in by_folder[name]}


def _token(stamps: Mapping[str, str]) -> str:
    relevant = {n: stamp for n, stamp in stamps.items() if n not in _IRRELEVANT and not n.endswith(TEMPORARY)}
    return hashlib.sha256(json.dumps(relevant, sort_keys=True).encode()).hexdigest()[:32]


# -- repeats: which are planned, which are done, and their rows --------------------------------------------------------


@dataclass(frozen=True)
class RepeatSurvey:
    """The state of a campaign's repeats in a store."""

    missing: frozenset[int]  # batches of the campaign with a missing repeat; none beyond the end of its table
    bad: list[str]  # what is wrong with bad files
    statuses: dict[str, int]  # number of repeats by status
    planned: int
    done: int  # of the planned ones, those that the store holds


def repeated_shares(store: Store, plan: PlanHeader) -> tuple[float, ...]:
    """Return the shares of samples that are repeated, rising: the plan's, and those requested later."""
    document = store.read_json(plan.campaign_id, REPEATS) or {"shares": []}
    added = document.get("shares")
    shares = (plan.repeats, *(added if isinstance(added, list) else [None]))
    numbers = [share for share in shares if isinstance(share, float | int) and not isinstance(share, bool)]
    if len(numbers) < len(shares) or not all(a < b <= 1.0 for a, b in pairwise(numbers)):
        raise StoreError(
            f"store {store.url}: {plan.campaign_id}/{REPEATS} says shares = {added!r:.60}; allowed: rising numbers"
            f" above {plan.repeats:g}, up to 1; restore it, or remove it and repeat samples again with clearcap repeat"
        )
    return tuple(map(float, numbers))


def add_share(store: Store, plan: PlanHeader, share: float) -> None:
    """Make a campaign repeat a larger share of its samples; existing repeats count towards it."""
    shares = repeated_shares(store, plan)
    if share > shares[-1] and len(shares) <= MOST_SETS:
        store.write_json(plan.campaign_id, REPEATS, {"shares": [*shares[1:], share]})


def repeat_plans(store: Store, plan: PlanHeader) -> tuple[RepeatPlan, ...]:
    """Return the sets of repeats of a campaign."""
    return plan_repeats(plan, repeated_shares(store, plan))


def survey_repeats(
    store: Store, sets: Sequence[RepeatPlan], *, verify: bool = False, mend: bool = False
) -> RepeatSurvey:
    """Return the state of some sets of repeats; ``verify`` reads every file, ``mend`` quarantines bad ones."""
    missing, bad, statuses = set[int](), list[str](), list[dict[str, int]]()
    for repeats in sets:
        survey = store.survey(repeats, verify)
        missing.update(repeats.campaign_batches[batch] for batch in survey.missing)
        bad += dict.fromkeys(survey.bad.values())
        statuses.append(survey.statuses)
        if mend:
            store.quarantine(repeats, survey.bad)
            store.record(repeats, survey.parts.values())
    counts = total(statuses)
    planned = sum(store.end(repeats) for repeats in sets)
    return RepeatSurvey(frozenset(missing), bad, counts, planned, sum(counts.values()))


def read_repeats(store: Store, plan: PlanHeader, columns: Sequence[str] | None = None) -> "pa.Table | None":
    """Return the repeats of a campaign that the store holds, set by set; None if no repeats are planned."""
    import pyarrow as pa

    sets = repeat_plans(store, plan)
    if not sets:
        return None
    names = sets[0].schema.names if columns is None else list(columns)
    empty = sets[0].schema.empty_table().select(names)
    return pa.concat_tables([empty, *(table for repeats in sets for table in store.stream(repeats, names))])
