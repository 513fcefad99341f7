"""The Python interface to a `clearcap serve` server: its calls, uploads, and the events of a campaign as they come."""

import json
import math
import re
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self
from urllib.parse import quote

from campaign.errors import SpecError, StoreError, UnreachableError, unwritable
from clearcap.client.server_connection import ServerConnection

if TYPE_CHECKING:
    import pyarrow as pa

LARGEST_FILE = 100_000_000  # bytes, as in `campaign.spec.named_files`


def campaign_upload(source: str | Path | Mapping[str, Any]) -> tuple[str, dict[str, bytes]]:
    """Return the text of a campaign file, a shipped campaign or tables, and the content of each file that it names.

    A file outside the folder of the campaign file is refused (SpecError): otherwise a campaign file written by somebody
    else could make this program send any file of this machine.
    """
    from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml

    if isinstance(source, Mapping):
        from campaign.spec.campaign_file import campaign_text
        from campaign.spec.load import with_named_mechanism

        named, mechanism = with_named_mechanism(source)
        own = {} if mechanism is None else {named["mechanism"]: mechanism.to_toml().encode()}
        rest = {key: value for key, value in named.items() if key != "mechanism" or not own}
        return campaign_text(named), own | _named_files(rest, Path())
    shipped = resources.files("campaign").joinpath("library", f"{source}.toml")
    is_shipped = str(source).replace("_", "").isalnum() and shipped.is_file()
    path = Path(str(shipped)) if is_shipped else Path(source)
    content = _content(path, LARGEST, f"campaign {path}")
    try:
        tables = parse_toml(content)
    except UnfitToml as error:
        raise SpecError(f"campaign {path}: {error}") from error
    return content.decode("utf-8-sig"), _named_files(tables, path.parent)


def _named_files(tables: Mapping[str, Any], folder: Path) -> dict[str, bytes]:
    """Return the contents of the files that a campaign's tables name, by name."""
    files = {}
    for key, name in _names(tables):
        path = folder / name
        try:
            # resolved, because a link beside the campaign file may lead anywhere
            is_within = path.resolve().is_relative_to(folder.resolve())
        except (OSError, ValueError, RuntimeError):  # a loop of links, a NUL in the name
            is_within = False
        if not is_within:
            raise SpecError(
                f"{key} = {name!r:.120}: lies outside the campaign file's folder, and is not sent to a server; copy it"
                " beside the campaign file"
            )
        content = _content(path, LARGEST_FILE, f"{key} = {name!r:.120}")
        files[name.removeprefix("./")] = _plain(path, content) if key == "mechanism" else content
    return files


def _plain(path: Path, content: bytes) -> bytes:
    """Return a mechanism file, with references to files, which a server does not open, replaced by numbers."""
    from engine.mechanism.meshes.resolved_meshes import names_meshes
    from engine.platform.toml_file import UnfitToml, parse_toml

    try:
        tables = parse_toml(content)
        names_geometry = "cad" in tables or names_meshes(tables)
    except UnfitToml:  # the server reports the fault
        return content
    if not names_geometry:
        return content
    from engine import load_mechanism

    return load_mechanism(path).to_toml().encode()


def _names(tables: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the key and the name of each file that a campaign's tables name."""
    mechanism = tables.get("mechanism")
    if isinstance(mechanism, str) and (Path(mechanism).suffix == ".toml" or len(Path(mechanism).parts) > 1):
        yield "mechanism", mechanism
    variables = tables.get("variables")
    entries = {f"variables.{key}": entry for key, entry in variables.items()} if isinstance(variables, Mapping) else {}
    for key, entry in {**entries, "table": tables.get("table")}.items():
        name = entry.get("file") if isinstance(entry, Mapping) else None
        if isinstance(name, str) and name:
            yield f"{key}.file", name


def _content(path: Path, at_most: int, what: str) -> bytes:
    """Return the content of a regular file."""
    from engine.platform.regular_file import read_regular_file

    try:
        return read_regular_file(path, at_most)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise SpecError(f"{what}: cannot be read ({reason}); name a file of this machine") from error


READ_TIMEOUT = 60.0  # s without data after which the connection counts as lost; a server sends something every 15 s
RECONNECT_FOR = 600.0  # s that a server may be unreachable
PIECE = 1 << 20  # bytes
ON_A_PAGE = 500  # campaigns
ASK_AGAIN = 0.5  # s between requests while the server still reads its store for the first time
GIVE_UP_AFTER = 60.0  # s without progress in that reading
MOST_NAMED = 10  # campaigns in a message
_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


def connect(address: str, token: str | None = None, ca: str | Path | None = None) -> "RemoteServer":
    """Return a connection to a `clearcap serve` server; nothing is sent yet.

    Parameters
    ----------
    address : str
        ``https://HOST[:PORT]``, or ``http://127.0.0.1:8700`` on the server's own machine.
    token : str, optional
        A token from the server's page Account; by default the value of the environment variable ``CLEARCAP_TOKEN``. It
        is sent to this address only, in a header, and never over the network without TLS.
    ca : str or Path, optional
        PEM file with the certificates of the authority that signed the server's certificate; by default the
        authorities that the system trusts.

    Returns
    -------
    RemoteServer

    Raises
    ------
    SpecError
        If the address, token or certificates cannot be used.
    """
    return RemoteServer(ServerConnection(address, token, ca))


class RemoteServer:
    """A `clearcap serve` server.

    The methods raise `SpecError` for an invalid request, with the faults of a file; `UnreachableError` or `StoreError`
    if the server cannot answer now; and `CampaignError` if the state of a campaign does not allow the request. Requests
    for documents, including `what_if` and `simulate`, and `submit` are tried up to five times if the server does not
    answer; changes and downloads are sent once.

    Parameters
    ----------
    connection : ServerConnection
    """

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def address(self) -> str:
        """The address of the server."""
        return self.connection.address

    def close(self) -> None:
        """Close the connection."""
        self.connection.close()

    # -- campaigns --------------------------------------------------------------------------------------------------

    def campaigns(self, **question: Any) -> Iterator[dict[str, Any]]:
        """Yield the list entry of each campaign, once the server has read them all; pages are requested as needed.

        Parameters
        ----------
        **question
            ``search``, ``owner``, ``tag`` (a list), ``state``, ``archived`` and ``sort``, as in the API.
        """
        cursor: str | None = ""
        while cursor is not None:
            listing = self._whole({**question, "cursor": cursor, "limit": ON_A_PAGE})
            yield from listing["campaigns"]
            cursor = listing["next"]

    def _whole(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Return a page of the list, once the server has read all campaigns."""
        least, since = math.inf, time.monotonic()
        while True:
            listing = self._document("/campaigns", params=params)
            unread, now = listing.get("unread", 0), time.monotonic()  # older servers read all before they answer
            if not unread:
                return listing
            if unread < least:
                least, since = unread, now
            elif now - since > GIVE_UP_AFTER:
                raise UnreachableError(
                    f"server {self.address}: {unread} campaigns of its store are still to be read, and none was read"
                    f" in {GIVE_UP_AFTER:.0f} s; its log says why; the same command works later"
                )
            time.sleep(ASK_AGAIN)

    def campaign(self, campaign_id: str) -> dict[str, Any]:
        """Return the list entry of one campaign."""
        return self._document(_path(campaign_id))

    def status(self, campaign_id: str) -> dict[str, Any]:
        """Return the progress of a campaign, the document of ``clearcap status --json``."""
        return self._document(_path(campaign_id, "status"))

    def find(self, wanted: str | None = None) -> str:
        """Return the id of the campaign that begins with `wanted`, or, for None, of the server's only campaign.

        A campaign whose runs only decide another one is meant only by its own id.
        """
        entries = list(self.campaigns(search=wanted or "", archived=True))
        ids: list[str] = [entry["campaign"] for entry in entries]
        if wanted is not None and wanted in ids:
            return wanted
        matching = [each for each in ids if wanted is None or each.startswith(wanted)]
        if len(matching) > 1:
            deciding = {each for entry in entries for each in entry.get("decided_by", ())}
            matching = [each for each in matching if each not in deciding] or matching
        if len(matching) == 1:
            return matching[0]
        named = ", ".join(matching[:MOST_NAMED]) + (" and others" if len(matching) > MOST_NAMED else "")
        if not matching:
            raise SpecError(
                f"server {self.address}: no campaign {wanted or ''}; list them: clearcap list --server {self.address}"
            )
        what = "name the campaign" if wanted is None else f"{wanted} could be several campaigns"
        raise SpecError(f"server {self.address}: {what}: {named}")

    def submit(
        self,
        source: str | Path | Mapping[str, Any],
        *,
        samples: int | None = None,
        seed: int | None = None,
        owner: str | None = None,
        tags: Iterable[str] = (),
        key: str | None = None,
    ) -> dict[str, Any]:
        """Submit a campaign with the files that it names; the server queues it.

        Parameters
        ----------
        source : str, Path or mapping
            Name of a shipped campaign, path of a campaign file, or its tables. The files that it names must be in the
            folder of the campaign file.
        samples, seed : int, optional
            Values that replace those of the source.
        owner : str, optional
            Owner of the campaign; by default the token's user.
        tags : iterable of str
        key : str, optional
            Idempotency key: for a day, requests with the same key and campaign count as one submission. By default a
            new key.

        Returns
        -------
        dict
            ``campaign`` (its id), ``is_new``, ``samples``, ``owner``, ``cost`` and ``note``.
        """
        text, named = campaign_upload(source)
        files = [("campaign", ("campaign.toml", text.encode())), *(("files", each) for each in named.items())]
        given = {"samples": samples, "seed": seed, "owner": owner, "tags": list(tags)}
        data = {name: value for name, value in given.items() if value is not None}
        headers = {"Idempotency-Key": key or uuid.uuid4().hex}
        return self._document("/campaigns", "POST", repeats=True, files=files, data=data, headers=headers)

    def events(self, campaign_id: str) -> Iterator[dict[str, Any]]:
        """Yield the progress of a campaign whenever it changes, until it ends; a lost connection is restored.

        Raises UnreachableError if the server cannot be reached for ten minutes.
        """
        last, tried, heard, path = "", 0, time.monotonic(), _path(campaign_id, "events")
        while True:
            headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": last} if last else {})
            try:
                with self.connection.stream(path, headers=headers, timeout=READ_TIMEOUT) as response:
                    for event in events_in(response.iter_lines()):
                        tried, heard = 0, time.monotonic()
                        if event.kind == "end":
                            return
                        if event.kind == "progress":
                            last = event.id or last  # an event without an id does not change what to continue after
                            yield json.loads(event.data)
            except (UnreachableError, StoreError):  # also from a proxy whose server restarts
                if time.monotonic() - heard > RECONNECT_FOR:
                    raise
            # also after a stream that ended without the event "end": a server that shuts down ends its streams so
            tried += 1
            self.connection.wait(tried)

    def cancel(self, campaign_id: str) -> dict[str, Any]:
        """End a campaign, keeping its rows; return its id, its previous state, and a note."""
        return self._document(_path(campaign_id, "cancel"), "POST")

    def resume(self, campaign_id: str) -> dict[str, Any]:
        """Queue a campaign again that ended before its last row; return the same as `cancel`."""
        return self._document(_path(campaign_id, "resume"), "POST")

    def label(self, campaign_id: str, **change: Any) -> dict[str, Any]:
        """Change the labels of a campaign; return its new list entry.

        Parameters
        ----------
        campaign_id : str
            Full id of the campaign.
        **change
            ``owner``, ``add_tags``, ``remove_tags``, ``note``, ``archived`` and ``version``, as in the API.
        """
        return self._document(_path(campaign_id, "labels"), "PATCH", json=change)

    # -- results ----------------------------------------------------------------------------------------------------

    def rows(self, campaign_id: str, columns: Iterable[str] = ()) -> "pa.Table":
        """Return the rows of a campaign as a pyarrow table; ``.to_pandas()`` converts it to a data frame.

        Parameters
        ----------
        campaign_id : str
            Full id of the campaign.
        columns : iterable of str
            Names of the columns; by default all.
        """
        import pyarrow as pa

        params = {"format": "arrow", "columns": list(columns)}
        with self.connection.stream(_path(campaign_id, "rows"), params=params) as response:
            content = pa.BufferOutputStream()
            for piece in response.iter_bytes(PIECE):
                content.write(piece)
        try:
            return pa.ipc.open_stream(content.getvalue()).read_all()
        except pa.ArrowException as error:
            raise StoreError(f"server {self.address}: what it sent is not a table ({error})") from error

    def download_report(self, campaign_id: str, folder: str | Path) -> dict[str, Path]:
        """Write the files of a campaign's report into a folder, which is created if it is missing.

        Returns
        -------
        dict of str to Path
            Path of each file by name.

        Raises
        ------
        SpecError
            If there is no report yet, or the folder cannot be written.
        """
        names = self._document(_path(campaign_id, "reports"))["files"]
        files = self._downloaded(_path(campaign_id, "reports/own"), names, folder)
        if not files:
            raise SpecError(f"campaign {campaign_id}: has no report yet; it is written when the campaign ends")
        return files

    def pool(self, campaign_id: str, others: Iterable[str], folder: str | Path) -> dict[str, Path]:
        """Write one report of campaigns that differ only in their seeds, and download its files into a folder.

        Parameters
        ----------
        campaign_id : str
            Full id of the campaign.
        others : iterable of str
            Full ids of the others.
        folder : str or Path
            It is created if it is missing.

        Returns
        -------
        dict of str to Path
            Path of each file by name.

        Raises
        ------
        SpecError
            If they differ in anything else, or the folder cannot be written.
        """
        made = self._document(_path(campaign_id, "pools"), "POST", json={"others": list(others)})
        below = _path(campaign_id, f"reports/pooled/{quote(made['pool'], safe='')}")
        return self._downloaded(below, made["files"], folder)

    def _downloaded(self, below: str, names: Iterable[str], folder: str | Path) -> dict[str, Path]:
        """Download files of one place into a folder; return the path of each by name."""
        named = [name for name in names if _FILE.fullmatch(name)]  # a server must not choose a path
        return {name: download(self.connection, f"{below}/{name}", Path(folder) / name) for name in named}

    def what_if(self, campaign_id: str, *settings: str) -> dict[str, Any]:
        """Return the results under other distributions, the document of ``clearcap whatif --json``.

        Parameters
        ----------
        campaign_id : str
            Full id of the campaign.
        *settings : str
            Changes of distributions, each ``VARIABLE.KEY=VALUE``, such as ``J1.std=0.01``.
        """
        return self._document(_path(campaign_id, "whatif"), "POST", repeats=True, json={"set": list(settings)})

    def signable(self, campaign_id: str) -> dict[str, Any]:
        """Return what an approver would sign now.

        Returns
        -------
        dict
            ``content``, the digest of all of it, for `sign`; the digests of ``plan``, ``rows`` and ``report``; the
            number of ``files``; ``submitted_by``, and whether that is the token's user, ``is_submitter``.
        """
        return self._document(_path(campaign_id, "signoffs/content"))

    def sign(self, campaign_id: str, content: str, comment: str = "") -> dict[str, Any]:
        """Sign plan, rows and report of a completed campaign, as an approver; return the signed document.

        Parameters
        ----------
        campaign_id : str
            Full id of the campaign.
        content : str
            Digest of what is signed, from `signable`. Ask for it before you read the report: if anything has changed
            since, nothing is signed.
        comment : str

        Raises
        ------
        SpecError
            If the token's user may not sign it.
        CampaignError
            If the campaign is not completed or has no report, the content has changed, or the report, made again from
            the rows, is another one.
        """
        wanted = {"content": content, "comment": comment}
        return self._document(_path(campaign_id, "signoffs"), "POST", json=wanted)

    # -- measured parts ---------------------------------------------------------------------------------------------

    def capability(
        self, parts: str | Path, limits: str | Path, folder: str | Path, files: Iterable[str] | None = None
    ) -> dict[str, Any]:
        """Send measured parts, which the server keeps, and download the capability report that it makes of them.

        Parameters
        ----------
        parts : str or Path
            CSV, Parquet or Excel file, one row a part.
        limits : str or Path
            TOML file with the characteristics and their limits.
        folder : str or Path
            It is created if it is missing.
        files : iterable of str, optional
            Names of the files to download; by default all of the report.

        Returns
        -------
        dict
            ``id``, ``title``, ``parts`` (how many), ``headline``, ``verdicts`` by characteristic, and ``report``, the
            path of each file by name.
        """
        # the same table with the same limits is kept once, so that the request may be repeated
        made = self._document("/measured", "POST", repeats=True, files=_measured_upload(parts, limits))
        if files is None:
            from clearcap.questions.uploaded_parts import KINDS
            from reporting.write import NAMES

            files = [NAMES[kind] for kind in KINDS]
        below = f"/measured/{quote(made['id'], safe='')}/files"
        return made | {"report": self._downloaded(below, files, folder)}

    def monitor(
        self, campaign_id: str, parts: str | Path, limits: str | Path | None = None, *, rerun: bool = False
    ) -> dict[str, Any]:
        """Give a campaign's variables the distributions of measured parts; see `clearcap.monitor_campaign`.

        Parameters
        ----------
        campaign_id : str
            Full id of the campaign, which must be the token's user's own.
        parts : str or Path
            CSV, Parquet or Excel file, one row a part.
        limits : str or Path, optional
            Limits file of the parts.
        rerun : bool
            Whether a campaign with the new distributions is queued where the rows give no answer.

        Returns
        -------
        dict
            The fields of `Monitored`.
        """
        data, files = {"rerun": str(rerun).lower()}, _measured_upload(parts, limits)
        return self._document(_path(campaign_id, "monitor"), "POST", files=files, data=data)

    # -- mechanisms -------------------------------------------------------------------------------------------------

    def mechanisms(self) -> dict[str, Any]:
        """Return the names of the mechanisms: ``shipped``, a list, and ``saved``, the newest version by name."""
        return self._document("/mechanisms")

    def mechanism(self, name: str) -> dict[str, Any]:
        """Return a mechanism: bodies, joints, clearances, responses, and every number that can be set."""
        return self._document(f"/mechanisms/{quote(name, safe='')}")

    def simulate(self, mechanism: str, values: Mapping[str, float] | None = None, **more: Any) -> dict[str, Any]:
        """Simulate a mechanism once on the server; return ``status``, ``responses``, ``units`` and ``certificate``.

        Parameters
        ----------
        mechanism : str
            Name of a shipped or saved mechanism.
        values : mapping of str to float, optional
            Values by key, in the mechanism's units.
        **more
            ``bench``, ``preset``, ``step`` and ``horizon``, as in the API.
        """
        body = {"mechanism": mechanism, "values": dict(values or {}), **more}
        return self._document("/simulations", "POST", repeats=True, json=body)

    def _document(self, path: str, method: str = "GET", **more: Any) -> dict[str, Any]:
        """Return an answer that is a JSON object."""
        answer = self.connection.get(path, **more) if method == "GET" else self.connection.ask(method, path, **more)
        document: dict[str, Any] = answer.json()
        return document


def _measured_upload(parts: str | Path, limits: str | Path | None) -> dict[str, tuple[str, bytes]]:
    """Return the files of a request with measured parts."""
    from campaign.store.measured_library import LARGEST_PARTS
    from engine.platform.toml_file import LARGEST

    table = Path(parts)
    files = {"file": (table.name, _content(table, LARGEST_PARTS, f"parts {parts}"))}
    if limits is not None:
        files["limits"] = ("limits.toml", _content(Path(limits), LARGEST, f"limits {limits}"))
    return files


def _path(campaign_id: str, below: str = "") -> str:
    """Return the API path of a campaign, or of a resource below it."""
    return f"/campaigns/{quote(campaign_id, safe='')}" + (f"/{below}" if below else "")


def download(connection: ServerConnection, path: str, file: Path) -> Path:
    """Download a file and return its path; it appears there only when it is complete."""
    partial = file.with_name(f"{file.name}.partial")
    with connection.stream(path) as response:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with partial.open("wb") as written:
                for piece in response.iter_bytes(PIECE):
                    written.write(piece)
            partial.replace(file)
        except OSError as error:
            raise unwritable(f"{file}: cannot be written ({error.strerror or error})", error) from error
        finally:
            partial.unlink(missing_ok=True)
    return file


@dataclass
class SentEvent:
    """A server-sent event."""

    kind: str = "message"  # name of the event
    data: str = ""
    id: str = ""  # a reconnecting client sends it to say what it has seen; empty if the event has none


def events_in(lines: Iterable[str]) -> Iterator[SentEvent]:
    """Yield the events in the lines, without line ends, of a stream; an incomplete last event is left out."""
    event, data = SentEvent(), list[str]()
    for line in lines:
        if not line:
            if data:
                event.data = "\n".join(data)
                yield event
            event, data = SentEvent(), []
            continue
        field, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if field == "event":
            event.kind = value
        elif field == "data":
            data.append(value)
        elif field == "id":
            event.id = value
