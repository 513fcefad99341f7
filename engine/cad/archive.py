"""What was read from a CAD file as the content of a file, and a cache of such files in the user's cache folder.

Dataclasses of numbers become a tree in JSON, and the arrays that it refers to, in NumPy's format (npz).
"""

import hashlib
import io
import json
import os
import tempfile
import zipfile
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np

from engine.cad.cad_model import CadAssembly
from engine.errors import FolderError
from engine.platform.build import hash_sources
from engine.platform.private_folder import user_cache

_T = TypeVar("_T")
_TREE = "tree"


def packed(value: Any) -> bytes:
    """Return a dataclass of numbers, texts, arrays, tuples and nested dataclasses as the content of a file."""
    arrays: list[Any] = []
    tree = json.dumps(_tree(value, arrays)).encode()
    named: dict[str, Any] = {str(place): array for place, array in enumerate(arrays)}
    named[_TREE] = np.frombuffer(tree, np.uint8)
    file = io.BytesIO()
    np.savez(file, **named)
    return file.getvalue()


def unpacked(kind: type[_T], content: bytes) -> _T:
    """Return the dataclass that `packed` wrote; raise ValueError if the content is damaged or of another class."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        tree = json.loads(arrays.pop(_TREE).tobytes())
        return cast(_T, _value(kind, tree, arrays))
    except (KeyError, TypeError, ValueError, AttributeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"not a {kind.__name__}: {error}") from error


def _tree(value: Any, arrays: list[Any]) -> Any:
    """Return a value as JSON; an array becomes its index among the arrays, a dataclass the list of its fields."""
    if is_dataclass(value):
        return [_tree(getattr(value, field.name), arrays) for field in fields(value)]
    if isinstance(value, tuple):
        return [_tree(entry, arrays) for entry in value]
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return len(arrays) - 1
    return value


def _value(kind: Any, tree: Any, arrays: dict[str, Any]) -> Any:
    """Return a value of a given type from its JSON."""
    if isinstance(kind, UnionType):
        [kind] = [NoneType] if tree is None else [each for each in get_args(kind) if each is not NoneType]
    if isinstance(kind, type) and is_dataclass(kind):
        each = zip(_field_kinds(kind).items(), tree, strict=True)
        return kind(**{name: _value(inner, entry, arrays) for (name, inner), entry in each})
    if get_origin(kind) is tuple:
        inner = get_args(kind)
        inner = inner[:1] * len(tree) if inner[-1] is Ellipsis else inner
        return tuple(_value(each, entry, arrays) for each, entry in zip(inner, tree, strict=True))
    # since NumPy 2.5, `numpy.typing.NDArray` is the name of a type of arrays
    is_array = get_origin(getattr(get_origin(kind), "__value__", kind)) is np.ndarray
    return arrays[str(tree)] if is_array else tree


@cache
def _field_kinds(kind: Any) -> dict[str, Any]:
    """Return the types of a dataclass's fields by name, in order."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}


# -- the cache --------------------------------------------------------------------------------------------------------

MOST_BYTES = 2**30  # limit for all files together; the least recently used are deleted first


def cached(sha256: str, recognition: float) -> CadAssembly | None:
    """Return what the same reader read from a file with this content and recognition gap [mm]; None if not cached."""
    answer = cached_answer(sha256, repr(recognition))
    with suppress(ValueError):  # the cached file is damaged
        return unpacked(CadAssembly, answer) if answer is not None else None
    return None


def cached_answer(sha256: str, question: str) -> bytes | None:
    """Return the reader's earlier answer to a question about a file with this content; None if it is not cached."""
    with suppress(FolderError, OSError, RuntimeError):  # RuntimeError: this user has no home folder
        file = user_cache("cad") / _name(sha256, question)
        answer = file.read_bytes()
        os.utime(file)  # the time of last use, by which `_make_room` chooses
        return answer
    return None


def keep_answer(sha256: str, question: str, answer: bytes) -> None:
    """Add the reader's answer to a question about a file to the cache; do nothing if there is no usable folder."""
    with suppress(FolderError, OSError, RuntimeError):
        folder = user_cache("cad")
        # renamed when complete: another process never reads half an answer
        with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
            file.write(answer)
        os.replace(file.name, folder / _name(sha256, question))
        _make_room(folder)


def _name(sha256: str, question: str) -> str:
    """Return the name of a cached file, which depends on the content, the reader and its settings."""
    how = hashlib.sha256(f"{_reader()} {question}".encode()).hexdigest()[:16]
    return f"{sha256}-{how}"


@cache
def _reader() -> str:
    """Return what the result depends on besides the file: the code of this package, and the version of OCCT."""
    try:
        occt = version("cadquery-ocp-novtk")
    except PackageNotFoundError:
        occt = ""
    return f"{hash_sources(Path(__file__).parent)} {occt}"


def _make_room(folder: Path) -> None:
    """Remove the least recently used files until the rest is small enough."""
    files = sorted(((file.stat(), file) for file in folder.iterdir()), key=lambda each: each[0].st_mtime, reverse=True)
    total = 0
    for status, file in files:
        total += status.st_size
        if total > MOST_BYTES:
            file.unlink(missing_ok=True)
