"""What ``import clearcap`` gives."""

import ast
import inspect
import os
import pydoc
import subprocess
import sys
from pathlib import Path

import pytest

import clearcap

CLASSES = (clearcap.Results, clearcap.PooledResults, clearcap.RunningCampaign, clearcap.RemoteServer)
SOURCE = ast.parse(Path(clearcap.__file__).read_text("utf-8"))


def test_every_name_is_there():
    """Each name of `__all__` can be imported, is listed by `dir`, and is documented."""
    assert dir(clearcap) == sorted([*clearcap.__all__, "__version__"])
    for name in clearcap.__all__:
        assert getattr(clearcap, name).__doc__


def test_help_fits_a_screen():
    """What `help` shows of a function, and says of a class, is at most 60 lines, without a type spelled out."""
    members = [getattr(clearcap, name) for name in clearcap.__all__]
    members += [m for c in CLASSES for m in vars(c).values() if callable(m)]
    for member in members:
        text = (inspect.getdoc(member) or "") if isinstance(member, type) else pydoc.plaintext.document(member)
        lines = text.splitlines()
        assert len(lines) <= 60, (member, len(lines))
        assert max(map(len, lines), default=0) <= 500, member


SCRIPT = """
import asyncio

import pandas as pd
from distributed import Client
from matplotlib.figure import Figure

import clearcap


def told(beat: clearcap.Heartbeat) -> None:
    print(beat.done, beat.left)


def read(rows: pd.DataFrame) -> None:
    print(rows["slide"].max())


class Follows:
    def __call__(self, beat: clearcap.Heartbeat) -> None:
        print(beat.left)

    def rows(self, rows: pd.DataFrame) -> None:
        print(rows["slide"].max())


async def awaited() -> clearcap.Results:
    running: clearcap.RunningCampaign = clearcap.submit_campaign("c60", seed=3, progress=told, rows=read, workers=2)
    print(running.id, running.heartbeat, running.results.statuses)
    return await running


mechanism: clearcap.Mechanism = clearcap.load_mechanism("incline").extended(simulation={"horizon": 0.4})
text: str = clearcap.load_mechanism(mechanism.to_dict()).to_toml()
run: clearcap.Run = clearcap.simulate(clearcap.load_mechanism_text(text), {"materials.block_slope.friction": 0.6})
print(run.responses["slide"], repr(run))
print([number.key for number in clearcap.settable_numbers(mechanism, "*.friction") if number.varies])
campaign = {"format": 1, "name": "slope", "mechanism": mechanism, "samples": 4, "variables": {}}
results: clearcap.Results = clearcap.run_campaign(campaign, progress=told, cluster=Client("tls://head:8786"))
clearcap.run_campaign(campaign, progress=Follows())
with clearcap.connect("https://clearcap.example") as server:
    seen = server.signable(results.id)
    print(server.sign(results.id, seen["content"], "as drawn")["signer"], server.pool(results.id, ["x"], "pooled"))
later = [asyncio.run(awaited()), clearcap.RunningCampaign(results, progress=told, rows=read).wait()]
clearcap.submit_campaign(campaign).cancel()
other = clearcap.open_campaign("slope-0123456789").repeat(0.5, workers=2, progress=False)
print(results.rows.index, results.capability, results.sensitivity.loc["slide"], results.what_if("friction.std=0.1"))
print(results.advise()["factor"], results.allocate({"variables": {}}).tolerances, results.replay(3).same)
print(results.confirm({"variables": {}}, workers=2, progress=False).proposal.cost)
pooled: clearcap.PooledResults = results.pool(other, other)
print(pooled.rows.index, pooled.capability["cpk"], pooled.sensitivity, pooled.report("html")["html"])
pooled.plot.causes("slide").set_title("both")
print(results.compare(other)["mean_difference"], results.design(2000, ["slide"])["samples"])
axes = results.plot.histogram("slide", Figure().subplots())
for draw in (results.plot.probability, results.plot.causes, results.plot.convergence):
    draw("slide", axes).set_title("slide")
files: dict[str, str] = results.report("html")
"""


@pytest.mark.slow
@pytest.mark.processes
def test_a_script_that_uses_all_of_it_is_typed(tmp_path):
    """Type checkers have nothing to say."""
    (tmp_path / "script.py").write_text(SCRIPT)
    root = Path(clearcap.__file__).parents[1]
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "pyproject.toml", tmp_path / "script.py"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root)
    assert done.returncode == 0, done.stdout


def test_type_checkers_see_the_same_names():
    """What is imported for type checkers alone is what is imported at run time."""
    block = next(node for node in SOURCE.body if isinstance(node, ast.If))
    imported = {a.name: node.module for node in block.body for a in node.names}
    assert imported == {name: clearcap._HOME.get(name, "engine") for name in clearcap.__all__}
    assert sorted(imported) == clearcap.__all__


def test_an_unknown_name_is_refused():
    """The message lists what there is."""
    with pytest.raises(AttributeError, match=r"'simulat'.*\bsimulate"):
        _ = clearcap.simulat


@pytest.mark.processes
@pytest.mark.parametrize("script", ["campaign", "engine"])
def test_a_script_of_a_package_s_name_is_told_so(tmp_path, script):
    """It hides the package of the same name: the message names the file, and what to do."""
    (tmp_path / f"{script}.py").write_text("import clearcap\nclearcap.load_campaign('c60')\n")
    environment = {**os.environ, "PYTHONPATH": str(Path(clearcap.__file__).parents[1])}
    environment.pop("PYTHONSAFEPATH", None)  # a test before may have left it behind: nothing is hidden then
    command = [sys.executable, f"{script}.py"]
    told = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert told.returncode == 1
    assert told.stderr.splitlines()[-1].endswith(f"hides clearcap's package {script}; rename this file or folder")


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
