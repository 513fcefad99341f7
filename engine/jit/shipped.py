"""Machine code that came with the package: compiled for a level of x86-64 processors, read and never written here.

A wheel may hold a *layer* for each level: the files in which Numba keeps kernels, by module, and `SEAL`, which says
what they were compiled from and with, and the digest of each. A layer is used if all this is what is installed here and
the processor has every instruction of its level. What is damaged is not used either. Then kernels are compiled as ever,
and the log says why (debug).

Numba runs what it reads. The layers lie among the sources of the engine: who can write there is trusted as they are.
"""

import hashlib
import json
import logging
import shutil
import sysconfig
from collections.abc import Mapping
from functools import cached_property
from importlib.metadata import version
from pathlib import Path

from engine.platform.build import engine_sources

FOLDER = Path(__file__).parent / "layers"
SEAL = "layer.json"

# What LLVM calls the instructions of each level (x86-64 psABI, section 3.1.1), the best level first.
_V3 = {"cx16", "sahf", "popcnt", "sse3", "sse4.1", "sse4.2", "ssse3"} | {
    *("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave")
}
LEVELS = {"x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}, "x86-64-v3": _V3}

_log = logging.getLogger(__name__)


class Layer:
    """The machine code for one level."""

    def __init__(self, folder: Path) -> None:
        self.level = folder.name
        self._folder = folder

    @cached_property
    def _seal(self) -> tuple[dict[str, str], dict[str, str]]:
        """What the code was compiled from and with, and the digest of each file; both empty if there is no code."""
        try:
            seal = json.loads((self._folder / SEAL).read_bytes())
            return dict(seal["compiled_from"]), dict(seal["files"])
        except FileNotFoundError:
            return {}, {}
        except (OSError, ValueError, KeyError, TypeError) as error:
            _log.debug("no compiled code of the package for %s is used: %s: %r", self.level, SEAL, error)
            return {}, {}

    def fits(self, processor: Mapping[str, bool]) -> bool:
        """Return whether the code is that of this installation, for a processor with these features or fewer."""
        made, _ = self._seal
        here = compiled_from()
        differ = [name for name, what in here.items() if made.get(name) != what]
        lacking = sorted(name for name in LEVELS[self.level] if not processor.get(name))
        if made and (differ or lacking):
            why = "; ".join(f"{name} {made.get(name)} there, {here[name]} here" for name in differ)
            why = why or f"the processor has no {', '.join(lacking)}"
            _log.debug("no compiled code of the package for %s is used: %s", self.level, why)
        return bool(made) and not differ and not lacking

    def folder_of(self, kernel: str) -> Path | None:
        """Return the folder with a kernel's code, whose files begin with this path; None if it is not as it was."""
        _, digests = self._seal
        files = {name: digest for name, digest in digests.items() if name.startswith(f"{kernel}.")}
        try:
            wrong = [name for name, digest in files.items() if _digest(self._folder / name) != digest]
        except OSError as error:
            wrong = [str(error)]
        if wrong:
            _log.debug("compiled code of the package for %s is not used: damaged: %s", self.level, wrong[0])
        return (self._folder / kernel).parent if files and not wrong else None


def layers(processor: Mapping[str, bool], level: str | None = None) -> list[Layer]:
    """Return the layers for a processor with these features, the best first; only that of ``level``, if given."""
    found = [Layer(FOLDER / name) for name in LEVELS if level in (None, name)]
    return [layer for layer in found if layer.fits(processor)]


def compiled_from() -> dict[str, str]:
    """Return what the machine code of kernels depends on, beside the processor.

    Python counts by its binary interface (``cpython-311-x86_64-linux-gnu``) and NumPy by its minor version, as Numba
    tells them apart: a wheel is for every Python 3.11.
    """
    return {
        "engine": engine_sources(),
        "numba": version("numba"),
        "llvmlite": version("llvmlite"),
        "numpy": ".".join(version("numpy").split(".")[:2]),
        "python": str(sysconfig.get_config_var("SOABI")),
    }


def ship(cache: Path, level: str) -> None:
    """Put what this installation has compiled for a level, which Numba keeps in a folder, into the package."""
    files = sorted(path for pattern in ("*.nbi", "*.nbc") for path in cache.rglob(pattern))
    if not files:
        raise FileNotFoundError(f"{cache}: nothing was compiled for {level}; does the package have this layer already?")
    digests = {}
    for path in files:
        name = path.relative_to(cache).as_posix()
        target = FOLDER / level / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
        digests[name] = _digest(target)
    content = json.dumps({"compiled_from": compiled_from(), "files": digests}, indent=1)
    (FOLDER / level / SEAL).write_text(f"{content}\n", "utf-8")


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
