"""Rows and single samples over the API: files, the worst first, one sample, its replay and its pictures."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from clearcap.questions.exported_rows import FORMATS
from clearcap.questions.samples import replay_sample
from engine import load_mechanism, read_trajectory

pytestmark = pytest.mark.processes


@pytest.fixture
def get(computing, explored):
    """Return what asks for something of the finished campaign, or of another, as a viewer."""
    client, headers = computing

    def asked(path, campaign=explored[0], extra=None, **params):
        headed = {**headers("viewer"), **(extra or {})}
        return client.get(f"/api/v1/campaigns/{campaign}/{path}", headers=headed, params=params)

    return asked


@pytest.fixture
def stored(computing_service, explored):
    return computing_service[0].store.table(explored[0])


def read(kind, content):
    """Return the table in a file."""
    source = io.BytesIO(content)
    if kind == "arrow":
        return pa.ipc.open_stream(source).read_all()
    return pq.read_table(source) if kind == "parquet" else pyarrow.csv.read_csv(source)


@pytest.mark.parametrize("kind", FORMATS)
def test_rows(get, stored, explored, kind):
    """Each format has the store's numbers; who has the file gets nothing again; a selection is another file."""
    answer = get("rows", format=kind)
    assert answer.headers["content-type"] == FORMATS[kind]
    assert explored[0] in answer.headers["content-disposition"]
    assert read(kind, answer.content)["FC-1"].to_pylist() == stored["FC-1"].to_pylist()
    tag = answer.headers["etag"]
    assert get("rows", format=kind, extra={"If-None-Match": tag}).status_code == 304
    part = get("rows", format=kind, columns=["FC-1", "sample"], first=3, last=12, status="ok")
    assert part.headers["etag"] != tag
    table = read(kind, part.content)
    assert table.column_names == ["FC-1", "sample"]
    expected = [n for n, s in zip(range(25), stored["status"].to_pylist(), strict=True) if s == "ok" and 3 <= n <= 12]
    assert table["sample"].to_pylist() == expected


def test_odd_rows(get):
    for odd in ({"format": "xls"}, {"columns": "none"}, {"first": 9, "last": 3}, {"last": -1}):
        assert get("rows", **odd).status_code == 422


def test_files_are_bounded_by_user(get, computing_service):
    service, _ = computing_service
    service.streams["viewer"] = service.settings.limits.streams
    try:
        answer = get("rows")
    finally:
        service.streams["viewer"] = 0
    assert (answer.status_code, answer.headers["retry-after"]) == (429, "5")


def test_worst_samples_come_first(get, computing_service, explored, stored):
    """In the order of their distance from the limit, in sigmas; pages of them meet."""
    plan = computing_service[0].store.plan(explored[0])
    lsl, usl, _ = plan.spec.responses["FC-1"].limits()
    x = stored["FC-1"].to_numpy()
    ends = np.array([np.inf if lsl is None else 1.0, np.inf if usl is None else 1.0])
    distance = np.fmin((x - (lsl or 0.0)) * ends[0], ((usl or 0.0) - x) * ends[1]) / np.nanstd(x, ddof=1)
    expected = [int(n) for n in np.argsort(distance, kind="stable") if np.isfinite(distance[n])]
    first = get("samples", limit=10).json()
    assert first["total"] == 25
    assert [each["sample"] for each in first["samples"]] == expected[:10]
    assert first["samples"][0]["margin"] == distance[expected[0]]
    assert first["samples"][0]["nearest"] == "FC-1"
    second = get("samples", limit=10, cursor=first["next"]).json()
    assert [each["sample"] for each in second["samples"]] == expected[10:20]
    assert get("samples", limit=10, cursor=second["next"]).json()["next"] is None


def test_samples_by_status(get):
    whole = get("samples", sort="sample").json()["samples"]
    assert [each["sample"] for each in whole] == list(range(25))
    failed = [each["sample"] for each in whole if each["status"] != "ok"]
    assert [each["sample"] for each in get("samples", sort="sample", status="failed").json()["samples"]] == failed
    assert get("samples", status="ok").json()["total"] == 25 - len(failed)
    assert get("samples", status="odd").status_code == 422
    assert get("samples", sort="odd").status_code == 422


def test_samples_by_columns(get, stored):
    """In the order of any column, those without a value last, and within ranges that have their ends."""
    j1, fc = (stored[name].to_numpy() for name in ("J1", "FC-1"))
    for sort, key in (("J1", j1), ("-J1", -j1), ("FC-1", fc), ("-FC-1", -fc), ("-sample", -np.arange(25))):
        listed = [each["sample"] for each in get("samples", sort=sort).json()["samples"]]
        assert listed == np.argsort(key, kind="stable").tolist(), sort
    middle = float(np.median(j1))
    found = get("samples", sort="sample", range=[f"J1:{middle!r}:", "FC-1::12.5"]).json()
    assert [each["sample"] for each in found["samples"]] == np.flatnonzero((j1 >= middle) & (fc <= 12.5)).tolist()
    assert found["samples"][0]["variables"]["J1"] == j1[found["samples"][0]["sample"]]
    for odd in ("J1", "J1:1", "none:1:2", "J1:nan:", "J1:x:", ":::", "status:1:2"):
        assert get("samples", range=odd).status_code == 422, odd


def test_sample(get, stored):
    shown = get("samples/7").json()
    row = stored.slice(7, 1).to_pylist()[0]
    assert shown["variables"]["J1"] == row["J1"]
    assert shown["responses"]["FC-1"] == row["FC-1"]
    assert shown["certificate"]["steps"] == row["steps"]
    assert shown["units"]["FC-1"] == "N"
    assert get("samples/25").status_code == 422
    assert get("samples/7", campaign="none").status_code == 404


def test_replay_says_whether_the_bits_are_the_same(computing, computing_service, explored):
    """Of real runs yes; of rows that a stand-in has computed no."""
    client, headers = computing
    path = f"/api/v1/campaigns/{explored[2]}/samples/3/replay"
    document = client.post(path, headers=headers("viewer")).json()
    assert (document["same"], document["differences"]) == (True, "")
    assert document["row"]["FC-1"] == document["stored"]["FC-1"]
    faked = path.replace(explored[2], explored[0])
    assert client.post(faked, headers=headers("viewer")).json()["same"] is False
    assert client.post(path).status_code == 401
    assert client.post(path.replace("/3/", "/4/"), headers=headers("viewer")).status_code == 422
    assert computing_service[0].audit.newest()[0].status == 422


def test_pictures_of_a_sample(get, explored):
    plot = get("samples/3/plot.svg", campaign=explored[2])
    assert plot.content.startswith(b"<?xml")
    assert (
        get("samples/3/plot.svg", campaign=explored[2], extra={"If-None-Match": plot.headers["etag"]}).status_code
        == 304
    )
    assert get("samples/3/motion.gif", campaign=explored[2]).content.startswith(b"GIF8")
    assert get("samples/4/motion.gif", campaign=explored[2]).status_code == 422


def test_motion_of_a_sample(get, explored, computing_service, tmp_path):
    """It ends when the run of the sample ends, in the units of the mechanism, and a second answer is the same."""
    answer = get("samples/3/motion.json", campaign=explored[2])
    motion = answer.json()
    frames = motion["frames"]
    assert motion["unit"] == "ms"
    assert {body["name"] for body in motion["bodies"]} == set(load_mechanism("c60").bodies)
    assert frames["time"] == sorted(frames["time"])
    store = computing_service[0].store
    replay_sample(store, explored[2], 3, tmp_path / "motion.h5")
    assert frames["time"][-1] == pytest.approx(read_trajectory(tmp_path / "motion.h5").time[-1], rel=1e-5)
    assert all(len(body["places"]) == len(frames["time"]) for body in frames["bodies"])
    assert get("samples/3/motion.json", campaign=explored[2]).headers["etag"] == answer.headers["etag"]
    assert get("samples/4/motion.json", campaign=explored[2]).status_code == 422
