"""Columns in mapped files: the store's to the last bit, built again when lost or damaged, bounded, private."""

import os
import stat

import numpy as np
import pytest

from campaign.errors import CampaignError, SpecError
from campaign.samples import independent_samples
from clearcap.web.jobs import column_cache
from clearcap.web.jobs.column_cache import ColumnCache, columns_folder, map_columns
from clearcap.web.jobs.queries import rows_version

pytestmark = pytest.mark.bits


def files(folder):
    """Return the files of columns."""
    return sorted(folder.glob("*.columns"))


def same(found, expected):
    """Return whether two sets of columns are the same to the bit; NaN is a value like others."""
    assert found.number.tobytes() == expected.number.tobytes()
    assert list(found.values) == list(expected.values)
    return all(found.values[name].tobytes() == column.tobytes() for name, column in expected.values.items())


def test_columns_are_those_of_the_store(filled, folder, monkeypatch):
    """The second time nothing is read from the store; missing values are NaN; nobody can write into them."""
    store, plan = filled
    expected, version = independent_samples(store, plan), rows_version(store, plan.campaign_id)
    assert 0 < np.isnan(expected.values["FC-1"]).sum() < 100
    cache = ColumnCache(folder)
    assert same(cache.columns(store, plan, version), expected)
    monkeypatch.setattr(column_cache, "grown_columns", lambda *_: pytest.fail("the store is read"))
    found = ColumnCache(folder).columns(store, plan, version)
    assert same(found, expected)
    with pytest.raises(ValueError, match="read-only"):
        found.values["J1"][0] = 1.0
    assert found.first(100).number.tolist() == list(range(100))
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert [stat.S_IMODE(path.stat().st_mode) for path in files(folder)] == [0o600]


def lost(path):
    path.unlink()


def cut_short(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def emptied(path):
    path.write_bytes(b"")


def changed(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("harm", [lost, cut_short, emptied, changed])
def test_what_is_lost_or_damaged_is_built_again(filled, folder, harm):
    """And is sound afterwards; who had it mapped before keeps what he had."""
    store, plan = filled
    expected, version = independent_samples(store, plan), rows_version(store, plan.campaign_id)
    cache = ColumnCache(folder)
    cache.columns(store, plan, version)
    harm(files(folder)[0])
    assert same(cache.columns(store, plan, version), expected)
    assert same(map_columns(files(folder)[0], version).columns, expected)


def test_a_file_of_other_columns_is_not_taken(filled, folder):
    """Even if it bears the name."""
    store, plan = filled
    cache = ColumnCache(folder)
    cache.columns(store, plan, "0" * 64)
    (path,) = files(folder)
    with pytest.raises(ValueError, match="other columns"):
        map_columns(path, "1" * 64)


def test_a_running_campaign_has_the_columns_of_its_rows_so_far(growing, folder):
    """Without rows there is one message; each version has its rows, and the one before is removed."""
    store, plan, compute = growing
    cache = ColumnCache(folder)
    with pytest.raises(CampaignError, match="no sample is computed yet"):
        cache.columns(store, plan, rows_version(store, plan.campaign_id))
    compute(0, 2)
    early = cache.columns(store, plan, rows_version(store, plan.campaign_id))
    assert early.number.tolist() == [*range(50), *range(100, 150)]
    compute(1)
    late = cache.columns(store, plan, rows_version(store, plan.campaign_id))
    assert late.number.tolist() == list(range(150))
    assert len(files(folder)) == 1
    assert early.number.size == 100  # it is mapped still
    assert np.isfinite(early.values["J1"]).all()


def test_the_folder_stays_within_its_size(filled, folder):
    """The files that were used least recently go, and what a killed process left behind."""
    store, plan = filled
    one = ColumnCache(folder)
    one.columns(store, plan, "0" * 64)
    size = files(folder)[0].stat().st_size
    for number, name in enumerate(("a", "b", "c")):
        path = folder / f"{name * 16}-{'0' * 32}.columns"
        path.write_bytes(bytes(size))
        os.utime(path, (1000 + number, 1000 + number))
    abandoned = folder / "x.tmp"
    abandoned.write_bytes(b"")
    os.utime(abandoned, (1000, 1000))
    ColumnCache(folder, at_most=2 * size + 100).columns(store, plan, "1" * 64)
    assert [path.name[0] for path in files(folder) if path.name[0] * 16 == path.name[:16]] == ["c"]
    assert len(files(folder)) == 2
    assert not abandoned.exists()


def test_columns_larger_than_the_folder_may_be_are_given_and_not_kept(filled, folder):
    """As are those that a full disk refuses."""
    store, plan = filled
    expected = independent_samples(store, plan)
    assert same(ColumnCache(folder, at_most=10).columns(store, plan, "0" * 64), expected)
    assert files(folder) == []


def test_a_full_disk_costs_time_only(filled, folder, monkeypatch, caplog):
    """The columns are given, and the log says why they are not kept."""
    store, plan = filled

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(column_cache, "write_columns", full)
    assert same(ColumnCache(folder).columns(store, plan, "0" * 64), independent_samples(store, plan))
    assert "No space left" in caplog.text


def test_the_folder_is_below_the_users_cache(tmp_path, monkeypatch):
    """One that somebody else may have filled is refused, with what to do."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert columns_folder() == tmp_path / "cache" / "clearcap" / "columns"
    foreign = tmp_path / "link"
    foreign.mkdir()
    (foreign / "clearcap").mkdir()
    (foreign / "clearcap" / "columns").mkdir()
    (foreign / "clearcap" / "columns" / "planted").symlink_to("/etc/passwd")
    monkeypatch.setenv("XDG_CACHE_HOME", str(foreign))
    with pytest.raises(SpecError, match=r"planted.*XDG_CACHE_HOME"):
        columns_folder()
