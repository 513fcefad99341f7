"""A private folder with the columns of campaigns, one memory-mapped file each; it may be deleted at any time."""

import fcntl
import hashlib
import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.reports.samples import SampleColumns
from campaign.store import Store
from campaign.web.answers.column_file import map_columns, write_columns
from campaign.web.answers.growing_columns import SourcedColumns, grown_columns
from engine import FolderError
from engine.platform.private_folder import private_folder

USUAL_SIZE = 4 << 30  # bytes; enough for thirty campaigns of a million rows
ABANDONED_AFTER = 3600.0  # s; no file takes this long to write
_ENDING = ".columns"
logger = logging.getLogger(__name__)


def columns_folder() -> Path:
    """Return the folder of the columns below the user's cache folder, which is ``XDG_CACHE_HOME`` or ``~/.cache``.

    Raises SpecError if another user could have written to it, or if it cannot be created.
    """
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
        return private_folder(cache, "clearcap", "columns")
    except (FolderError, OSError, RuntimeError) as error:  # RuntimeError: this user has no home folder
        raise SpecError(
            f"the columns of campaigns cannot be kept: {error}; name a folder in which only you can write with"
            " XDG_CACHE_HOME"
        ) from error


class ColumnCache:
    """Cache of the columns of campaigns that questions read, in a folder that only this user can access.

    Beyond `at_most` bytes the least recently used files are removed.
    """

    def __init__(self, folder: Path, at_most: int = USUAL_SIZE) -> None:
        self._folder, self._at_most = folder, at_most

    def columns(self, store: Store, plan: Plan, version: str) -> SampleColumns:
        """Return the columns of a campaign, from their file if there is an intact one, otherwise from the store.

        `version` is that of its rows; see `campaign.web.answers.rows_version`. The file of an earlier version is
        replaced; rows whose parts have not changed are taken from it. Raises CampaignError if there are no rows.
        """
        place = hashlib.sha256(f"{store.url}\n{plan.campaign_id}".encode()).hexdigest()[:16]
        path = self._folder / f"{place}-{version[:32]}{_ENDING}"
        with self._only_one(place):  # if several processes need the same columns, one of them builds them
            if (kept := self._kept(path, version)) is not None:
                return kept.columns
            sourced = grown_columns(store, plan, self._earlier(place))
            try:
                write_columns(path, version, sourced)
            except OSError as error:
                logger.warning("the columns of %s are not kept: %s", plan.campaign_id, error.strerror or error)
                return sourced.columns
            self._remove_superseded(path, place)
            self._remove_oldest()
            # mapped columns take no memory of this process, so that of the columns read from the store is freed
            return map_columns(path, version, just_written=True).columns if path.exists() else sourced.columns

    def _kept(self, path: Path, version: str | None) -> SourcedColumns | None:
        """Return the columns in a file; None if the file is missing or damaged."""
        try:
            sourced = map_columns(path, version)
            os.utime(path)  # its last use, by which `_remove_oldest` sorts
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            logger.warning("the columns are built again: %s", error)
            return None
        return sourced

    def _earlier(self, place: str) -> SourcedColumns | None:
        """Return the columns of an earlier version of the rows; None if there is no intact file of them."""
        return next(filter(None, (self._kept(path, None) for path in self._folder.glob(f"{place}-*{_ENDING}"))), None)

    @contextmanager
    def _only_one(self, place: str) -> Iterator[None]:
        """Hold a lock on the columns of a campaign; there are only sixteen lock files, so they are never removed."""
        with open(self._folder / f"{place[0]}.lock", "wb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _remove_superseded(self, path: Path, place: str) -> None:
        """Remove the files of earlier versions; a process that has mapped one can still read it."""
        for other in self._folder.glob(f"{place}-*{_ENDING}"):
            if other != path:
                other.unlink(missing_ok=True)

    def _remove_oldest(self) -> None:
        """Remove the least recently used files until the rest is small enough, and leftovers of killed processes."""
        found = []
        for path in self._folder.iterdir():
            with suppress(FileNotFoundError):
                status = path.stat()
                if path.suffix == ".tmp" and time.time() - status.st_mtime > ABANDONED_AFTER:
                    path.unlink()
                elif path.suffix == _ENDING:
                    found.append((status.st_mtime, path, status.st_size))
        total = sum(size for *_, size in found)
        for _, path, size in sorted(found):
            if total <= self._at_most:
                return
            path.unlink(missing_ok=True)
            total -= size
