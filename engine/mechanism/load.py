"""Read a mechanism from a TOML file, or a shipped one by its name."""

import tomllib
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from engine.errors import MechanismError
from engine.mechanism.faults import did_you_mean
from engine.mechanism.models import Mechanism, mechanism_from

_LARGEST = 1_000_000


def library_names() -> list[str]:
    """Return the names of the shipped mechanisms, sorted."""
    shipped = files("engine.mechanism").joinpath("library").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in shipped if file.name.endswith(".toml"))


def load_mechanism(name_or_path: str | Path) -> Mechanism:
    """Load a mechanism.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped mechanism, or path of a TOML file. A name has neither a folder nor ``.toml`` in it.

    Returns
    -------
    Mechanism
        Frozen and checked.

    Raises
    ------
    MechanismError
        When it cannot be found or read, or with one line for each fault of the file.
    """
    text = str(name_or_path)
    if isinstance(name_or_path, str) and text in library_names():
        shipped = files("engine.mechanism").joinpath("library", f"{text}.toml")
        return _parse(_read(shipped, text), text)
    path = Path(name_or_path)
    if not path.exists() and path.suffix != ".toml" and len(path.parts) == 1:
        known = library_names()
        raise MechanismError(
            f"{text}: no such mechanism; shipped are {', '.join(known)}; "
            f"name one of them, or give the path of a TOML file{did_you_mean(text, known)}"
        )
    return _parse(_read(path, text), text)


def _read(file: Path | Traversable, source: str) -> str:
    """Return the text of a file; a MechanismError says why it cannot be read."""
    try:
        if isinstance(file, Path) and file.stat().st_size > _LARGEST:
            raise MechanismError(
                f"{source}: {file.stat().st_size} bytes; allowed: up to {_LARGEST}; is this a mechanism file?"
            )
        return file.read_bytes().decode("utf-8")
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise MechanismError(f"{source}: cannot be read ({reason}); give a mechanism's TOML file") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise MechanismError(f"{source}: line {line}: not UTF-8 text; save the file as UTF-8") from None


def _parse(text: str, source: str) -> Mechanism:
    """Parse TOML and check it."""
    try:
        data = tomllib.loads(text)
    except ValueError as error:  # also a whole number of thousands of digits, which is no TOMLDecodeError
        raise MechanismError(f"{source}: not TOML: {error}; correct the file there") from None
    except RecursionError:
        raise MechanismError(f"{source}: not a mechanism: nested too deeply; correct the file") from None
    return mechanism_from(data, source)
