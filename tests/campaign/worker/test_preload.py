"""What a worker of this machine loads ahead: its batches' modules, pyarrow without pandas, the engine if compiled."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

import engine
from campaign.cluster.cluster import Cluster
from campaign.cluster.workers import connect_workers
from campaign.worker import preload

ARRAYS_WITHOUT_PANDAS = """
import sys
from campaign.worker.preload import keep_pandas_out
keep_pandas_out()
import pyarrow as pa
table = pa.table({"x": pa.array([1.0, None]), "y": pa.array(["a", "b"])})
assert table["x"].to_pylist() == [1.0, None] and table["x"].drop_null().to_numpy().tolist() == [1.0]
assert not any(name.partition(".")[0] == "pandas" for name in sys.modules)
import pandas
assert pandas.Series([1]).sum() == 1
"""


@pytest.fixture
def quiet(monkeypatch):
    """Leave this process's pyarrow alone, and return what is called of the engine."""
    called = []
    monkeypatch.setattr(preload, "keep_pandas_out", lambda: None)
    monkeypatch.setattr(engine, "warm_up", lambda: called.append("warm_up"))
    return called


@pytest.mark.processes
def test_arrays_do_not_load_pandas():
    """In a process of its own, arrays are made and read without pandas, which can still be imported after that."""
    subprocess.run([sys.executable, "-c", ARRAYS_WITHOUT_PANDAS], check=True)


@pytest.mark.parametrize(("missing", "called"), [((), ["warm_up"]), (("time_loop.nbi",), [])])
def test_compiled_engine_is_loaded_and_never_compiled(quiet, monkeypatch, missing, called):
    """An engine that is not compiled waits for the one worker that compiles it for all."""
    monkeypatch.setattr(engine, "missing_kernels", lambda: missing)
    preload.load_ahead()
    assert quiet == called
    assert set(preload.BATCHES_NEED) <= sys.modules.keys()


def test_worker_starts_even_if_nothing_can_be_loaded(quiet, monkeypatch):
    """The coordinator hears of it with the first batch, in the words of that error."""
    monkeypatch.setattr(preload, "BATCHES_NEED", ("campaign.worker.no_such_module",))
    preload.load_ahead()
    assert quiet == []


@pytest.mark.processes
def test_worker_of_this_machine_loads_in_the_thread_of_its_batches():
    """When the first call comes, what batches need is there, and pandas is not."""
    with connect_workers(Cluster(workers=1)) as workers:
        call = workers.submit("loaded", loaded, (*preload.BATCHES_NEED, "pandas"))
        assert workers.next_finished() is call
        assert call.result() == [True, True, False]


def test_versions_are_known_before_another_thread_imports(monkeypatch):
    """A worker states them when it joins, and an import at the same time can hide one."""
    order = []
    monkeypatch.setattr(preload, "get_versions", lambda: order.append("versions"))
    submit = lambda call: order.append(call.__name__)  # noqa: E731
    preload.dask_setup(SimpleNamespace(executors={"default": SimpleNamespace(submit=submit)}))
    assert order == ["versions", "load_ahead"]


def loaded(names):
    """Return whether modules are loaded."""
    return [name in sys.modules for name in names]
