"""What ``import clearcap`` gives."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import clearcap

SOURCE = ast.parse(Path(clearcap.__file__).read_text("utf-8"))


def test_every_name_is_there():
    """Each name of `__all__` can be imported, is listed by `dir`, and is documented."""
    assert dir(clearcap) == sorted([*clearcap.__all__, "__version__"])
    for name in clearcap.__all__:
        assert getattr(clearcap, name).__doc__


def test_type_checkers_see_the_same_names():
    """What is imported for type checkers alone is what is imported at run time."""
    block = next(node for node in SOURCE.body if isinstance(node, ast.If))
    imported = {a.name: node.module for node in block.body for a in node.names}
    assert imported == clearcap._HOME
    assert sorted(imported) == clearcap.__all__


def test_an_unknown_name_is_refused():
    """The message lists what there is."""
    with pytest.raises(AttributeError, match=r"no attribute 'simulat'; it has .*simulate"):
        _ = clearcap.simulat


@pytest.mark.processes
def test_import_is_light():
    """Neither tables nor the compiler are loaded before they are used."""
    heavy = ("numba", "pandas", "dask", "pydantic", "engine", "campaign", "reporting")
    code = f"import sys, clearcap; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_packages_are_typed():
    """Type checkers read the annotations of all packages that are installed."""
    root = Path(clearcap.__file__).parents[1]
    assert all((root / package / "py.typed").exists() for package in ("clearcap", "engine", "campaign", "reporting"))


@pytest.mark.processes
def test_module_is_the_command():
    """`python -m clearcap` is `clearcap`."""
    command = [sys.executable, "-P", "-m", "clearcap", "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.startswith("clearcap")
