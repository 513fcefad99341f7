"""Columns that grow are those that reading all rows again would give, to the byte of their file."""

from dataclasses import replace

import pyarrow.compute as pc
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from campaign.errors import CampaignError
from campaign.plan import make_plan
from campaign.samples import independent_samples
from campaign.store import open_store, rows
from campaign.store.files import local
from campaign.store.layout import STOPPED
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from clearcap.web.jobs.column_cache import ColumnCache
from clearcap.web.jobs.queries import rows_version
from engine.platform.private_folder import private_folder
from tests.clearcap.web.conftest import only_in_a_folder
from tests.clearcap.web.jobs.conftest import fails_where_wide

pytestmark = pytest.mark.bits


@pytest.fixture
def exact(monkeypatch):
    """Have no file count as one that changed just now, so that two looks at the same files agree on their stamps."""
    monkeypatch.setattr(local, "RECENT", -1e9)


@pytest.fixture
def read(monkeypatch):
    """Return the names of the files of rows that were read, as they are read."""
    names, original = [], rows.read_file

    def reading(files, plan, name, *rest):
        names.append(name)
        return original(files, plan, name, *rest)

    monkeypatch.setattr(rows, "read_file", reading)
    return names


def content(cache, folder, store, plan):
    """Return the file that a cache in a folder has of a campaign now."""
    cache.columns(store, plan, rows_version(store, plan.campaign_id))
    (path,) = folder.glob("*.columns")
    return path.read_bytes()


def replace_rows(store, plan, batch):
    """Write other rows of a batch, and record them, as a repetition of failed ones does."""
    _, table = store.read_own_part(plan, batch)
    at = table.schema.get_field_index("FC-1")
    other = pc.add(table["FC-1"], 1.0)
    store.write_part(plan, batch, table.set_column(at, table.schema.field(at), other))
    store.record(plan, store.survey(plan, verify=True).parts.values())


def test_only_rows_that_came_are_read(growing, folder, tmp_path, exact, read):
    """Whatever their order; what was replaced is read again, and a version without new rows reads none."""
    store, plan, compute = growing
    cache = ColumnCache(folder)
    for act, names in (
        (lambda: compute(0, 5), ["part-000000.parquet", "part-000005.parquet"]),
        (lambda: compute(2, 7), ["part-000002.parquet", "part-000007.parquet"]),
        (lambda: replace_rows(store, plan, 5), ["part-000005.parquet"]),
        (lambda: store.record(plan, store.survey(plan).parts.values()), []),
        (lambda: compute(1, 3, 4, 6), [f"part-00000{number}.parquet" for number in (1, 3, 4, 6)]),
        (lambda: store.compact(plan), ["rows-000000-000007.parquet"]),
    ):
        act()
        read.clear()
        grown = content(cache, folder, store, plan)
        assert read == names
        other = private_folder(tmp_path / "rebuilt", f"{len(names)} {names}")
        assert grown == content(ColumnCache(other), other, store, plan)


@only_in_a_folder
def test_rows_that_changed_just_now_are_read_again(growing, folder, read):
    """A second change in the same tick of the clock would not be seen."""
    store, plan, compute = growing
    cache = ColumnCache(folder)
    compute(0)
    cache.columns(store, plan, rows_version(store, plan.campaign_id))
    compute(1)
    read.clear()
    cache.columns(store, plan, rows_version(store, plan.campaign_id))
    assert read == ["part-000000.parquet", "part-000001.parquet"]


ACTS = st.one_of(
    st.tuples(st.just("compute"), st.lists(st.integers(0, 7), min_size=1, max_size=4, unique=True)),
    st.tuples(st.just("replace"), st.integers(0, 7)),
    st.tuples(st.just("damage"), st.integers(0, 7)),
    st.tuples(st.just("lose"), st.integers(0, 7)),
    st.tuples(st.just("stop"), st.integers(1, 128)),
    st.tuples(st.sampled_from(["compact", "record", "quarantine"]), st.none()),
)


def act_on(store, plan, compute, what, which):
    """Do one thing that changes the rows of a campaign, if it is possible now."""
    part = f"{plan.campaign_id}/parts/part-{which or 0:06d}.parquet" if isinstance(which, int) else ""
    if what == "compute":
        compute(*set(which) & set(store.survey(plan, verify=True).missing))
    elif what == "stop":
        store.write_json(plan.campaign_id, STOPPED, {"samples": which})
    elif what == "compact":
        store.compact(plan)
    elif what == "record":
        store.record(plan, store.survey(plan).parts.values())
    elif what == "quarantine":
        store.quarantine(plan, store.survey(plan).bad)
    elif store.files.exists(part):
        if what == "replace" and which not in store.survey(plan, verify=True).bad:
            replace_rows(store, plan, which)
        elif what == "damage":
            store.files.write(part, store.files.read(part)[:-7])
        elif what == "lose":
            store.files.remove(part)


@pytest.fixture
def begun(campaign, tmp_path_factory, monkeypatch):
    """Return what begins a campaign of 128 samples in 8 batches: its store and plan, what computes batches, folders."""
    monkeypatch.setattr("os.fsync", lambda _: None)  # which takes most of the time

    def begin(sampler):
        root = tmp_path_factory.mktemp("growing")
        store, folders = open_store(str(root / "runs")), [private_folder(root, name) for name in ("grown", "new")]
        spec = campaign.spec.model_copy(update={"samples": 128, "sampler": sampler})
        plan = store.create_plan(make_plan(replace(campaign, spec=spec), 16))
        address = CampaignAddress.of(store, plan, fails_where_wide)
        return store, plan, lambda *batches: [run_batch(address, BatchRequest(batch)) for batch in batches], folders

    return begin


@pytest.mark.slow
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(acts=st.lists(ACTS, min_size=2, max_size=7))
@pytest.mark.parametrize("sampler", ["random", "saltelli"])
def test_grown_is_rebuilt(begun, exact, sampler, acts):
    """Rows that come in any order, are replaced, damaged, lost, merged, or lie beyond where the campaign stops."""
    store, plan, compute, (grown, rebuilt) = begun(sampler)
    cache = ColumnCache(grown)
    for what, which in [("compute", [3]), *acts]:
        act_on(store, plan, compute, what, which)
        try:
            expected = independent_samples(store, plan)
        except CampaignError:
            with pytest.raises(CampaignError, match="no sample"):
                cache.columns(store, plan, rows_version(store, plan.campaign_id))
            continue
        found = content(cache, grown, store, plan)
        for path in rebuilt.glob("*.columns"):
            path.unlink()
        assert found == content(ColumnCache(rebuilt), rebuilt, store, plan)
        mapped = cache.columns(store, plan, rows_version(store, plan.campaign_id))
        assert mapped.number.tobytes() == expected.number.tobytes()
        assert all(mapped.values[name].tobytes() == column.tobytes() for name, column in expected.values.items())
