"""Rows as Arrow, Parquet and CSV: what the store has, selected, a piece at a time."""

import io

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from campaign.errors import SpecError
from campaign.store.rows import ROW_GROUP
from clearcap.questions import exported_rows
from clearcap.questions.exported_rows import FORMATS, RowSelection, SentBytes, _writer, export_rows, rows_etag


def read(kind, content):
    """Return the table in the bytes of an export."""
    source = io.BytesIO(content)
    if kind == "arrow":
        return pa.ipc.open_stream(source).read_all()
    if kind == "parquet":
        return pq.read_table(source)
    return pyarrow.csv.read_csv(source)


@pytest.mark.parametrize("kind", FORMATS)
def test_all_rows_come_as_they_are_stored(filled, kind):
    """Values, order and nulls are the store's; Arrow and Parquet have units too."""
    store, plan = filled
    expected = store.table()
    found = read(kind, b"".join(export_rows(store, plan, kind)))
    assert found.column_names == expected.column_names
    assert found["sample"].to_pylist() == list(range(400))
    assert found["FC-1"].to_pylist() == expected["FC-1"].to_pylist()
    assert found["J1"].to_pylist() == expected["J1"].to_pylist()
    assert found["FC-1"].null_count > 0
    assert found["status"].to_pylist() == expected["status"].to_pylist()
    if kind != "csv":
        assert found.schema.equals(expected.schema, check_metadata=True)
        assert found.equals(expected)


@pytest.mark.parametrize("kind", FORMATS)
def test_columns_and_rows_are_selected(filled, kind):
    """In the order in which columns are named, both ends of the range among them."""
    store, plan = filled
    whole = store.table()
    asked = RowSelection(("FC-1", "sample"), 75, 210, ("not_converged",))
    found = read(kind, b"".join(export_rows(store, plan, kind, asked)))
    expected = [
        number
        for number, status in zip(whole["sample"].to_pylist(), whole["status"].to_pylist(), strict=True)
        if status == "not_converged" and 75 <= number <= 210
    ]
    assert 0 < len(expected) < 136
    assert found.column_names == ["FC-1", "sample"]
    assert found["sample"].to_pylist() == expected


@pytest.mark.parametrize("kind", FORMATS)
def test_a_selection_of_nothing_is_a_sound_file(growing, kind):
    """As is the export of a campaign without rows."""
    store, plan, compute = growing
    columns = ("sample", "FC-1")
    assert read(kind, b"".join(export_rows(store, plan, kind, RowSelection(columns)))).num_rows == 0
    compute(0)
    empty = RowSelection(columns, 1000)
    assert read(kind, b"".join(export_rows(store, plan, kind, empty))).column_names == list(columns)


def test_it_is_made_while_it_is_read(filled, monkeypatch):
    """Tables are read when their bytes are asked for, and none behind the last sample."""
    store, plan = filled
    monkeypatch.setattr("campaign.store.rows.ROW_GROUP", 50)
    assert ROW_GROUP > 50
    taken = []

    def counted(*words):
        for table in type(store).stream(store, *words):
            taken.append(len(table))
            yield table

    monkeypatch.setattr(store, "stream", counted)
    pieces = export_rows(store, plan, "csv")
    assert taken == []
    next(pieces), next(pieces)
    assert taken == [50]
    list(pieces)
    assert taken == [50] * 8
    taken.clear()
    list(export_rows(store, plan, "csv", RowSelection(last=99)))
    assert taken == [50] * 2


@pytest.mark.parametrize(
    ("kind", "selection", "words"),
    [
        ("xlsx", RowSelection(), "allowed: arrow, parquet, csv"),
        ("csv", RowSelection(("J9",)), "column J9: .* allowed: sample"),
        ("csv", RowSelection(("J1", "J1")), "named twice"),
        ("csv", RowSelection(first=9, last=3), "samples 9 to 3"),
    ],
)
def test_what_cannot_be_exported_is_said_before_anything_is_sent(filled, kind, selection, words):
    """With what is allowed."""
    with pytest.raises(SpecError, match=words):
        export_rows(*filled, kind, selection)


def test_the_same_bytes_have_the_same_name(filled, monkeypatch):
    """Rows, format, selection and version of the program each make another."""
    store, plan = filled
    first, second = (b"".join(export_rows(store, plan, "parquet")) for _ in range(2))
    assert first == second
    names = {
        rows_etag("v1", "csv", RowSelection()),
        rows_etag("v2", "csv", RowSelection()),
        rows_etag("v1", "arrow", RowSelection()),
        rows_etag("v1", "csv", RowSelection(("J1",))),
    }
    assert len(names) == 4
    assert rows_etag("v1", "csv", RowSelection()) in names
    monkeypatch.setattr(exported_rows, "clearcap_version", lambda: "another")
    assert rows_etag("v1", "csv", RowSelection()) not in names


def test_no_text_of_a_csv_is_a_formula():
    """Neither a name of a column nor a value; the other formats keep what is there."""
    names = ["=1+1", "@x", "+y", "-z", "\tw", "J1"]
    table = pa.table([*([[1.0]] * 5), ["=cmd()"]], names=names)
    for kind, mark in (("csv", "'"), ("arrow", "")):
        sent = SentBytes()
        with _writer(kind, sent, table.schema) as writer:
            writer.write_table(table)
        found = read(kind, sent.taken())
        assert found.column_names == [*(mark + name for name in names[:5]), "J1"]
        assert found["J1"].to_pylist() == [f"{mark}=cmd()"]
