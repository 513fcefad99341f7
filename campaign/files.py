"""Files of a store, in a folder or behind any fsspec URL: each is written whole or not at all."""

import os
import secrets
import tempfile
from pathlib import Path

import fsspec

from campaign.errors import SpecError, StoreError

TEMPORARY = ".tmp"  # ending of files that are being written


class Files:
    """Reads and writes under one root.

    Parameters
    ----------
    url : str
        A folder's path, or an fsspec URL.

    Attributes
    ----------
    local : bool
        The root is a folder of this machine.
    shared : bool
        Other processes see the same files.

    Raises
    ------
    SpecError
        If the URL names no file system that is installed here.
    """

    def __init__(self, url: str) -> None:
        try:
            self.fs, root = fsspec.url_to_fs(url)
        except (ValueError, ImportError) as error:
            raise SpecError(f"store {url}: {error}; name a folder, or a URL fsspec can open") from error
        self.url = url
        self.root = str(root).rstrip("/")
        protocols = {self.fs.protocol} if isinstance(self.fs.protocol, str) else set(self.fs.protocol)
        self.local = "file" in protocols
        self.shared = "memory" not in protocols

    def path(self, name: str) -> str:
        """Return the full path of a name relative to the root."""
        return f"{self.root}/{name}"

    def check_writable(self) -> None:
        """Make sure that files can be written, leaving none.

        Raises
        ------
        SpecError
            If not.
        """
        try:
            if self.local:
                _probe_folder(Path(self.root))
            else:
                probe = self.path(f"probe-{secrets.token_hex(4)}{TEMPORARY}")
                self.fs.pipe_file(probe, b"")
                self.fs.rm_file(probe)
        except Exception as error:  # every file system has its own
            reason = error.strerror if isinstance(error, OSError) and error.strerror else error
            raise SpecError(f"store {self.url}: not writable ({reason}); name a folder you may write to") from error

    def read(self, name: str) -> bytes:
        """Return a file's content; FileNotFoundError if it is not there, StoreError if it cannot be read."""
        try:
            return bytes(self.fs.cat_file(self.path(name)))
        except FileNotFoundError:
            raise
        except OSError as error:
            raise StoreError(f"store {self.url}: {name} cannot be read ({error})") from error

    def exists(self, name: str) -> bool:
        """Return whether there is such a file or folder."""
        return bool(self.fs.exists(self.path(name)))

    def names(self, folder: str) -> list[str]:
        """Return the names in a folder, sorted; none if there is no such folder."""
        try:
            self.fs.invalidate_cache()
            entries = self.fs.ls(self.path(folder).rstrip("/"), detail=False)
        except (FileNotFoundError, NotADirectoryError):
            return []
        except OSError as error:
            raise StoreError(f"store {self.url}: {folder or 'the store'} cannot be listed ({error})") from error
        return sorted(str(entry).rstrip("/").rsplit("/", 1)[-1] for entry in entries)

    def write(self, name: str, content: bytes, *, exclusive: bool = False) -> bool:
        """Write a file whole or not at all.

        Parameters
        ----------
        name : str
            Where, relative to the root; a file already there is replaced.
        content : bytes
            What.
        exclusive : bool
            Leave a file that is already there.

        Returns
        -------
        bool
            Whether it was written.
        """
        try:
            if self.local:
                return _write_local(Path(self.path(name)), content, exclusive)
            if exclusive and self.exists(name):
                return False
            self.fs.pipe_file(self.path(name), content)  # object stores put all or nothing
            return True
        except OSError as error:
            raise StoreError(
                f"store {self.url}: {name} cannot be written ({error.strerror or error});"
                " free or repair the disk, then run the same command again"
            ) from error

    def rename(self, old: str, new: str) -> None:
        """Rename a file, replacing one of the new name."""
        try:
            self.fs.mv(self.path(old), self.path(new))
        except OSError as error:
            raise StoreError(f"store {self.url}: {old} cannot be renamed to {new} ({error})") from error

    def sweep(self, folder: str) -> None:
        """Remove what writers that were killed left behind in a folder."""
        for name in self.names(folder):
            if name.endswith(TEMPORARY) and self.exists(f"{folder}/{name}"):
                self.fs.rm_file(self.path(f"{folder}/{name}"))


def _probe_folder(folder: Path) -> None:
    """Write and remove a file in the folder, or in the nearest one above it that exists."""
    existing = folder
    while not existing.exists():
        existing = existing.parent
    with tempfile.TemporaryFile(dir=existing):
        pass


def _write_local(path: Path, content: bytes, exclusive: bool) -> bool:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{secrets.token_hex(4)}{TEMPORARY}")
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if exclusive:
            try:
                os.link(temporary, path)
            except FileExistsError:
                return False
            return True
        os.replace(temporary, path)
        return True
    finally:
        temporary.unlink(missing_ok=True)
