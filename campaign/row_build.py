"""The installed version, and the build that computes rows: all sources and libraries that a row depends on.

A row depends on its campaign and its number besides.

Components that carry a row without changing it are left out: the store, which seals rows and reads them back bit for
bit; pyarrow, which holds them in between; and pydantic, which reads the spec, whose values are in the plan.
`campaign.compiling` decides when the engine is compiled, not what. The coordinator and the cluster are left out too: a
row does not depend on where and in which order rows are computed.
"""

import hashlib
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from engine.platform.build import LIBRARIES, engine_sources, hash_sources

DISTRIBUTIONS = Path(__file__).parents[1] / "reporting" / "distributions"
SOURCES = ("inputs", "spec", "worker", "batches.py", "plan.py", "plan_header.py", "row_build.py")  # of campaign
UNKNOWN = ""  # for plans of earlier versions, which recorded only the build of the engine


@lru_cache(maxsize=1)
def row_build() -> str:
    """Return the build of this installation; with the same one and type of processor, machines compute the same row."""
    # It has hashes of sources, and versions of Python and numerical libraries: ``engine 5d0e..., campaign 9ab1...,
    # distributions 77c0..., python 3.11.7, numpy 2.4.1, ...``.
    ingredients = {
        "engine": engine_sources(),
        "campaign": hash_sources(Path(__file__).parent, SOURCES),
        "distributions": hash_sources(DISTRIBUTIONS),
        "python": platform.python_version(),
        **{name: version(name) for name in (*LIBRARIES, "scipy")},
    }
    return ", ".join(f"{name} {value}" for name, value in ingredients.items())


def short_build() -> str:
    """Return the build of this installation in 12 characters, such as for the tag of an image."""
    return hashlib.sha256(row_build().encode()).hexdigest()[:12]


def differences(planned: str) -> str:
    """Describe how this installation differs from the build of a plan; empty if they are the same."""
    if planned == UNKNOWN:
        return "an earlier version of clearcap planned it, which did not record all that rows depend on"
    there, here = _ingredients(planned), _ingredients(row_build())
    words = []
    for name in {**there, **here}:
        if there.get(name) != here.get(name):
            what = f"sources of {name}" if name in ("engine", "campaign", "distributions") else name
            words.append(f"{what} {here.get(name, 'none')} here, {there.get(name, 'none')} in the plan")
    return "; ".join(words)


def _ingredients(build: str) -> dict[str, str]:
    return {name: value for name, _, value in (item.partition(" ") for item in build.split(", "))}


def clearcap_version() -> str:
    """Return the installed version, or ``not installed`` if the sources run without installation."""
    try:
        return version("clearcap")
    except PackageNotFoundError:
        return "not installed"
