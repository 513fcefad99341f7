"""An engine that must be compiled: one process does, and whoever asks meanwhile hears at once when to come again."""

import asyncio
import logging
from functools import partial

import pytest

from clearcap.web import web_service
from clearcap.web.jobs.pool import EngineCompiling
from clearcap.web.jobs.process import JobPostponed
from clearcap.web.settings import Settings
from tests.clearcap.web.conftest import serving
from tests.clearcap.web.jobs import strange_jobs
from tests.clearcap.web.jobs.test_job_pool import in_pool
from tests.clearcap.web.running import until_true
from tests.until import until

pytestmark = pytest.mark.processes

BROWSER = {"Accept": "text/html"}


def compiled_in(folder, warm_up=strange_jobs.compile_slowly):
    """Return what a pool is told of an engine that is compiled in a folder, once there is a file ``go`` in it."""
    given = str(folder)
    return {"warm_up": partial(warm_up, given), "is_compiled": partial(strange_jobs.is_compiled, given)}


def test_one_process_compiles_while_jobs_are_refused(tmp_path, caplog):
    """The others load what it has compiled; afterwards jobs are answered."""
    caplog.set_level(logging.INFO, "clearcap")

    async def ask(pool):
        with pytest.raises(EngineCompiling, match=r"\d+ s\b") as refused:
            await pool.run("u", strange_jobs.add, 1, 2)
        assert 5 <= refused.value.retry_after_s <= 30
        assert pool.compilation.seconds >= 0.0
        assert (pool.turns.running, pool.turns.waiting) == (0, 0)
        (tmp_path / "go").touch()
        await until_true(lambda: pool.compilation.seconds is None)
        for _ in range(3):
            assert (await pool.data("u", strange_jobs.add, 1, 2))["sum"] == 3
        await until_true(lambda: len((tmp_path / "calls").read_text()) == 3)
        return (tmp_path / "calls").read_text()

    assert in_pool(ask, processes=3, **compiled_in(tmp_path)) == "cll"
    assert [record.message[:10] for record in caplog.records] == ["compiling ", "the engine"]


def test_compiled_engine_is_waited_for(tmp_path):
    """Loading takes seconds, in which a job waits for its answer as for its turn."""
    (tmp_path / "compiled").touch()

    async def ask(pool):
        answers = await asyncio.gather(*(pool.data("u", strange_jobs.add, 1, n) for n in range(3)))
        assert pool.compilation.seconds is None
        return [answer["sum"] for answer in answers]

    assert in_pool(ask, processes=2, **compiled_in(tmp_path)) == [1, 2, 3]
    assert set((tmp_path / "calls").read_text()) == {"l"}


def test_next_process_compiles_if_the_first_one_dies(tmp_path):
    """A process that was ended amid compiling leaves nobody waiting for it."""
    (tmp_path / "go").touch()

    async def ask(pool):
        sums = []
        while not sums:
            try:
                sums.append((await pool.data("u", strange_jobs.add, 1, 2))["sum"])
            except JobPostponed:
                await asyncio.sleep(0.05)
        assert pool.compilation.seconds is None
        return sums

    assert in_pool(ask, **compiled_in(tmp_path, strange_jobs.compile_and_die)) == [3]
    assert (tmp_path / "calls").read_text() == "cc"


@pytest.fixture
def compiling(tmp_path, monkeypatch):
    """Return a client of a service that compiles until there is a file ``go``, and headers of an engineer."""
    for name, job in zip(("warm_up_try_out", "engine_is_compiled"), compiled_in(tmp_path).values(), strict=True):
        monkeypatch.setattr(web_service, name, job)
    with serving(Settings(str(tmp_path / "runs"), tmp_path / "data", processes=1)) as (service, client):
        secret = service.tokens.add("engineer", "test", web_service_role(service), 3600.0)[1]
        yield client, {"Authorization": f"Bearer {secret}"}, tmp_path / "go"


def web_service_role(service):
    """Return the role of the user ``engineer``."""
    return service.users.get("engineer").role


def test_calls_and_pages_say_what_goes_on(compiling):
    """Problem details for programs; a page that loads itself again, without scripts; not ready, and why."""
    client, headers, go = compiling
    call = client.post("/api/v1/simulations", json={"mechanism": "c60"}, headers=headers)
    assert call.status_code == 503, call.text
    assert call.headers["content-type"] == "application/problem+json"
    assert "the engine is being compiled for this machine" in call.json()["detail"]
    assert 5 <= int(call.headers["Retry-After"]) <= 30
    ready = client.get("/readyz")
    assert (ready.status_code, "is being compiled" in ready.json()["detail"]) == (503, True)
    assert client.get("/healthz").status_code == 200
    page = client.get("/mechanisms/c60/try", headers=headers | BROWSER)
    assert page.status_code == 503
    assert "the engine is being compiled for this machine" in page.text
    assert '<meta http-equiv="refresh" content="5">' in page.text
    assert client.get("/campaigns", headers=headers | BROWSER).status_code == 200  # needs no job
    go.touch()
    seen = []
    until(lambda: seen.append(client.get("/readyz")) or seen[-1].status_code != 503, "it is ready")
    assert all("is being compiled" in ready.json()["detail"] for ready in seen[:-1])
    page = client.get("/mechanisms/c60/try", headers=headers | BROWSER)
    assert page.status_code == 200
    assert "http-equiv" not in page.text


def test_form_is_not_loaded_again_by_itself(compiling):
    """What was typed would be lost: its page says to send it again."""
    client, headers, _ = compiling
    form = {"action": "check", "text": "name = 'x'"}
    page = client.post("/campaigns/new", data=form, headers=headers | BROWSER)
    assert page.status_code == 503, page.text
    assert "http-equiv" not in page.text
    assert "send the form again" in page.text
