"""Machine code in the user's folder: what is damaged there is compiled anew."""

import logging

import numba
import pytest

from engine.jit.kept_code import index_file, keep_on_disk

DAMAGES = {
    "empty": lambda content: b"",
    "first half": lambda content: content[: len(content) // 2],
    "last byte gone": lambda content: content[:-1],
    "zeros": lambda content: bytes(len(content)),
}


def doubled(x):
    """Return twice a number."""
    return 2.0 * x


def kept():
    """Return the function as a process sees it that has not called it yet."""
    compiled = numba.njit(doubled)
    keep_on_disk(compiled)
    return compiled


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_damaged_file_counts_as_missing(suffix, damage, tmp_path, monkeypatch, caplog):
    """Index or code, as after a power failure: one line says so, and the kernel is compiled and kept again."""
    caplog.set_level(logging.WARNING)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert not index_file(kept())[1]
    assert kept()(2.0) == 4.0
    [file] = tmp_path.rglob(f"*.{suffix}")
    file.write_bytes(DAMAGES[damage](file.read_bytes()))
    again = kept()
    assert index_file(again)[1] == (suffix == "nbc")  # only the index is read before the code is needed
    assert again(2.0) == 4.0
    assert sum(again.stats.cache_misses.values()) == 1
    [record] = caplog.records
    assert str(file.parent) in record.getMessage()
    other = kept()
    assert index_file(other)[1]
    assert other(2.0) == 4.0
    assert sum(other.stats.cache_hits.values()) == len(caplog.records) == 1


def test_code_for_callers_is_not_kept(tmp_path, monkeypatch):
    """Of the code that callers would link only the name is kept of what Python calls, and the kernel can be called."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert kept()(2.0) == 4.0
    loaded = kept()
    assert loaded(2.0) == 4.0
    [result] = loaded.overloads.values()
    assert [f.name for f in result.library._shared_module.functions] == [result.fndesc.llvm_cpython_wrapper_name]
