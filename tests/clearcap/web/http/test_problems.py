"""The status of a refusal: 4xx for what the user can mend, 5xx for what the server cannot do."""

import json

import pytest

from campaign.errors import CampaignError, SpecError, StoreError
from clearcap.web.http.responses import problem, refusal_of
from clearcap.web.jobs import queries
from clearcap.web.jobs.pool import Busy
from clearcap.web.jobs.process import JobFailed, JobPostponed, JobTooLarge
from engine import EngineError
from tests.clearcap.web.jobs import strange_jobs
from tests.each import each


@each(
    ("error", "status", "comes_back"),
    [
        (SpecError("std = -1"), 422, None),
        (EngineError("step = 0"), 422, None),
        (JobTooLarge("it takes more than 60 s of processor time; ask for less"), 422, None),
        (CampaignError("no sample is computed yet"), 409, None),
        (Busy("16 jobs of eva wait", 7), 429, "7"),
        (JobFailed("its process ended by signal 11"), 500, None),
        (JobPostponed("no process could be started"), 503, "10"),
        (StoreError("the store cannot be reached"), 503, "10"),
    ],
)
def test_status_says_whose_fault_it_is(error, status, comes_back):
    refusal = refusal_of(error)
    assert (refusal.status, refusal.headers.get("Retry-After")) == (status, comes_back)
    assert refusal.detail == str(error)


def test_every_text_can_be_sent():
    """A name of a file that is no UTF-8 is written out; no body has such a name for what is to be set."""
    assert json.loads(problem(503, "parts/\udcff: damaged").model_dump_json())["detail"] == "parts/\\udcff: damaged"


def test_bug_is_no_refusal():
    assert refusal_of(KeyError("x")) is None


@pytest.mark.processes
@pytest.mark.parametrize(
    ("job", "status", "words"),
    [
        (strange_jobs.answer_by_a_bug, 500, "a bug in the program (KeyError)"),
        (
            strange_jobs.read_what_was_deleted,
            409,
            "is not in the store; if its campaign was deleted or changed just now",
        ),
        (strange_jobs.answer_too_much, 422, "its answer has more than 64 MiB; ask for less"),
    ],
)
def test_question_whose_job_goes_wrong(computing, explored, monkeypatch, job, status, words):
    """The answer is problem details, with the reason and without its details."""
    client, headers = computing
    monkeypatch.setattr(queries, "what_if_answer", job)
    asked = f"/api/v1/campaigns/{explored[1]}/whatif"
    answer = client.get(asked, params={"set": "J1.std=0.018"}, headers=headers("viewer"))
    assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")
    assert words in answer.json()["detail"]
    assert "secret" not in answer.text
