"""The files that a campaign names: files of a folder, or a closed set of contents given with its text.

And the names of the campaigns that are shipped.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Protocol

from campaign.errors import SpecError
from engine import load_mechanism, load_mechanism_text
from engine.mechanism import Mechanism, library_names
from engine.mechanism.faults import did_you_mean
from engine.platform.regular_file import UnfitFile, read_regular_file
from engine.preflight.start_gaps import with_start_gaps

MOST_FILES = 100  # given with a campaign's text
LARGEST_TOTAL = 200_000_000  # bytes of all given files
LONGEST_NAME = 200  # characters


def campaign_names() -> list[str]:
    """Return the names of the shipped campaigns."""
    folder = resources.files("campaign").joinpath("library")
    return sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml"))


class NamedFiles(Protocol):
    """Access to the files that a campaign names."""

    def mechanism(self, name: str) -> Mechanism:
        """Return the mechanism of this name; MechanismError or SpecError if it does not exist or has faults."""

    def content(self, name: str, at_most: int) -> bytes:
        """Return the content of a data file of at most ``at_most`` bytes; SpecError, without the key, on failure."""

    def may_quote(self, name: str) -> bool:
        """Return whether a message may quote the content of a data file."""


@dataclass(frozen=True)
class FolderFiles:
    """Files by path, relative to a folder: all files that the user of this process may read."""

    folder: Path
    inline: Mechanism | None = None  # built in code, instead of a file

    def mechanism(self, name: str) -> Mechanism:
        """Return a shipped mechanism or one from a file; MechanismError if it does not exist or has faults."""
        if self.inline is not None:
            return self.inline
        is_path = Path(name).suffix == ".toml" or len(Path(name).parts) > 1
        return with_start_gaps(load_mechanism(self.folder / name if is_path else name))

    def content(self, name: str, at_most: int) -> bytes:
        """Return the content of a regular file; SpecError if it does not exist or cannot be read."""
        path = self.folder / name
        try:
            return read_regular_file(path, at_most)
        except (FileNotFoundError, ValueError) as error:  # ValueError: a NUL in the name
            what = path if isinstance(error, OSError) else error
            raise SpecError(f"no such file ({what}); paths are relative to the campaign file") from error
        except UnfitFile as error:
            most = f"files of up to {at_most // 1_000_000} MB; keep only the columns and rows that the campaign needs"
            raise SpecError(f"cannot be read ({error.strerror}); allowed: {most}") from error
        except OSError as error:
            kind = path.suffix.lower()[1:]
            raise SpecError(f"cannot be read ({error.strerror or error}); name a readable {kind} file") from error

    def may_quote(self, name: str) -> bool:
        """Return whether a file lies in the folder; others are not quoted, as a campaign may name any file."""
        try:
            return (self.folder / name).resolve().is_relative_to(self.folder.resolve())
        except (OSError, ValueError, RuntimeError):  # a loop of links, a NUL in the name
            return False


class GivenFiles:
    """Files given with the text of a campaign, which cannot name any others, by names such as ``data/gaps.csv``."""

    def __init__(self, contents: Mapping[str, bytes]) -> None:
        total = sum(map(len, contents.values()))
        if len(contents) > MOST_FILES or total > LARGEST_TOTAL:
            raise SpecError(
                f"{len(contents)} files of {total} bytes are given with the campaign; allowed: {MOST_FILES} files and"
                f" {LARGEST_TOTAL} bytes in all; give only those that it names"
            )
        for name in contents:
            if len(name) > LONGEST_NAME or not name.isprintable() or not re.fullmatch(_RELATIVE, name):
                raise SpecError(
                    f"{name!a:.120}: no name of a file that is given with a campaign; allowed: relative names such as"
                    f" latch.toml or data/gaps.csv, up to {LONGEST_NAME} characters, without .. and \\; rename it"
                )
        self._contents = dict(contents)

    def mechanism(self, name: str) -> Mechanism:
        """Return a shipped or a given mechanism; raises the same errors as `NamedFiles`."""
        if name in library_names():
            return load_mechanism(name)
        return load_mechanism_text(self._given(name, f", and shipped mechanisms: {', '.join(library_names())}"), name)

    def content(self, name: str, at_most: int) -> bytes:
        """Return the content of a given file; SpecError if it was not given or is too large."""
        content = self._given(name)
        if len(content) > at_most:
            raise SpecError(
                f"has {len(content)} bytes; allowed: up to {at_most}; keep only the columns and rows that the campaign"
                " needs"
            )
        return content

    def may_quote(self, name: str) -> bool:
        """Return True: the sender of a file may see its content quoted."""
        return True

    def _given(self, name: str, others: str = "") -> bytes:
        """Return the content of a file; if it was not given, SpecError lists the given ones."""
        content = self._contents.get(name.removeprefix("./"))
        if content is None:
            names = f": {', '.join(self._contents)}" if self._contents else "; no file was given"
            raise SpecError(
                f"no such file is given with the campaign; allowed: those that are{names}{others}; give it too, or name"
                f" another{did_you_mean(name, [*self._contents, *(library_names() if others else ())])}"
            )
        return content


_RELATIVE = r"(?!.*(?:^|/)\.{0,2}(?:/|$))[^\\:]+"  # no part may be empty, . or ..; no drive letter
