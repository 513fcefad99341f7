"""The upload of a campaign: its text, and the files that it names."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from campaign.errors import SpecError

LARGEST_FILE = 100_000_000  # bytes, as in `campaign.spec.named_files`


@dataclass(frozen=True)
class CampaignUpload:
    """A campaign as it is sent."""

    text: str  # content of the campaign file
    files: dict[str, bytes]  # content of each file that the campaign names, by name

    def to_form(self) -> list[tuple[str, tuple[str, bytes]]]:
        """Return the upload as files of a form for the API."""
        campaign = "campaign", ("campaign.toml", self.text.encode())
        return [campaign, *(("files", (name, content)) for name, content in self.files.items())]


def campaign_upload(source: str | Path | Mapping[str, Any]) -> CampaignUpload:
    """Read a campaign file, a shipped campaign or tables, and the files that they name, for an upload.

    Paths in tables are relative to the current folder. Raises SpecError if a file cannot be read, or lies outside the
    folder of the campaign file: otherwise a campaign file written by somebody else could make this program send any
    file of this machine.
    """
    from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml

    if isinstance(source, Mapping):
        from campaign.spec.campaign_file import campaign_text
        from campaign.spec.load import with_named_mechanism

        named, mechanism = with_named_mechanism(source)
        text = campaign_text(named)
        if mechanism is None:
            return CampaignUpload(text, _named_files(named, Path()))
        own = {named.pop("mechanism"): mechanism.to_toml().encode()}
        return CampaignUpload(text, own | _named_files(named, Path()))
    path = _path_of(str(source))
    content = _content(path, LARGEST, f"campaign {path}")
    try:
        tables = parse_toml(content)
    except UnfitToml as error:
        raise SpecError(f"campaign {path}: {error}") from error
    return CampaignUpload(content.decode("utf-8-sig"), _named_files(tables, path.parent))


def _path_of(name_or_path: str) -> Path:
    """Return the path of a campaign file or, for the name of a shipped campaign, that of its file."""
    if name_or_path.replace("_", "").isalnum():
        shipped = resources.files("campaign").joinpath("library", f"{name_or_path}.toml")
        if shipped.is_file():
            return Path(str(shipped))
    return Path(name_or_path)


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
    """Return a mechanism file, with references to a CAD file, which a server does not open, replaced by numbers."""
    from engine.platform.toml_file import UnfitToml, parse_toml

    try:
        names_geometry = "cad" in parse_toml(content)
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
