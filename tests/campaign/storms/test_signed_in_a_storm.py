"""Signing, withdrawing, deleting, computing again, resuming and cancelling at once, while the server is killed."""

import os
import random
import threading
from contextlib import suppress
from itertools import count

import httpx
import psutil
import pytest

from campaign.coordinator.requests import delete_campaign, request_rerun
from campaign.errors import CampaignError
from campaign.store import open_store
from clearcap.questions.signing import Signoff, Withdrawal, open_archive, read_document
from clearcap.questions.verification import verify_export
from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.database import Database
from tests.campaign.storms.server import DATABASE
from tests.clearcap.web.running import PATIENCE, Served
from tests.until import until

pytestmark = [pytest.mark.slow, pytest.mark.processes]

STORMS = int(os.environ.get("CLEARCAP_SIGNED_STORMS", "2"))
KILLS = 4
SIGNATURES = 4  # that are waited for
MEDDLING = {"delete": 1, "beside": 1, "cancel": 1, "rerun": 2, "resume": 2, "report": 2, "submit": 3}  # how often
API = "/api/v1/campaigns"
SLOPE = """\
format = 1
name = "{name}"
mechanism = "incline"
samples = 12

[failures]
min_ok = 0

[simulation]
horizon = 0.3

[variables.friction]
target = "materials.block_slope.friction"
distribution = "uniform"
lower = 0.4
upper = 0.8

[responses.slide]
usl = 5.0
"""


class Person:
    """Who asks a server that may be gone; what was asked and answered is remembered in order."""

    def __init__(self, url, headers):
        self._http = httpx.Client(base_url=url, headers=headers, timeout=PATIENCE, trust_env=False)

    def ask(self, method, path, **more):
        """Return the answer; None if the server was killed meanwhile."""
        try:
            answer = self._http.request(method, path, **more)
        except httpx.TransportError:
            return None
        assert answer.status_code != 500, answer.text
        return answer

    def leave(self):
        """Close the connection."""
        self._http.close()


class Storm:
    """Three campaigns of a server, and what was acknowledged of each: sign-offs, withdrawals, deletions."""

    def __init__(self, folder, seed):
        self.folder, self.chance = folder, random.Random(seed)
        self.server = Served(folder, "--workers", "1").wait()
        headers = {role: self.server.token(role) for role in ("approver", "admin")}
        self.approver, self.meddler, self.looker = (
            Person(self.server.url, headers[role]) for role in ("approver", "admin", "admin")
        )
        self.texts, self.signed, self.counts, self.numbers = {}, {}, {}, count()
        for name in ("one", "two", "three"):
            text = SLOPE.format(name=name)
            answer = self.submit(text)
            assert answer.is_success, answer.text
            self.texts[answer.json()["campaign"]] = text
        self.store = open_store(str(folder / "runs"))
        self.over, self.faults = threading.Event(), []

    def submit(self, text):
        """Hand a campaign in; one that was deleted begins anew."""
        return self.meddler.ask("POST", API, json={"text": text, "tags": []})

    def state(self, campaign):
        """Return the state of a campaign; None if the server does not answer."""
        answer = self.looker.ask("GET", f"{API}/{campaign}")
        return None if answer is None else answer.json().get("state", "gone")

    def settle(self):
        """Wait until each campaign has an end and a report."""
        for campaign in self.texts:
            until(lambda campaign=campaign: self.state(campaign) in ("completed", "gone"), self.server.said)

    def sign(self):
        """Sign what can be signed, and withdraw every fourth."""
        campaign = self.chance.choice(list(self.texts))
        seen = self.approver.ask("GET", f"{API}/{campaign}/signoffs/content")
        if seen is None or not seen.is_success:
            return
        body = {"content": seen.json()["content"], "comment": f"number {next(self.numbers)}"}
        answer = self.approver.ask("POST", f"{API}/{campaign}/signoffs", json=body)
        self.note("sign", answer)
        if answer is not None and answer.status_code == 201:
            self.signed[campaign, answer.json()["comment"]] = answer.json()
            if self.chance.random() < 0.25:
                body = {"comment": "looked again"}
                self.note("withdraw", self.approver.ask("POST", f"{API}/{campaign}/signoffs/withdrawal", json=body))

    def meddle(self):
        """Do one of those things that a signed campaign must bear, over the API or beside the server."""
        campaign = self.chance.choice(list(self.texts))
        (kind,) = self.chance.choices(list(MEDDLING), list(MEDDLING.values()))
        if kind == "delete":
            answer = self.meddler.ask("DELETE", f"{API}/{campaign}", headers={"X-Confirm": campaign})
        elif kind == "submit":
            self.submit(self.texts[campaign])
            return
        elif kind == "beside":
            with suppress(CampaignError):
                if self.chance.random() < 0.5:
                    delete_campaign(self.store, campaign)
                else:
                    request_rerun(self.store, campaign, [], "somebody")
            return
        else:
            body = {"json": {"statuses": []}} if kind == "rerun" else {}
            answer = self.meddler.ask("POST", f"{API}/{campaign}/{kind}", **body)
        self.note(kind, answer)

    def note(self, kind, answer):
        """Count an answer."""
        key = kind, 0 if answer is None else answer.status_code
        self.counts[key] = self.counts.get(key, 0) + 1

    def repeat(self, act, pause):
        """Do it until the storm is over, with pauses of up to so many seconds; a fault ends it."""
        try:
            while not self.over.is_set():
                act()
                self.over.wait(self.chance.uniform(0.0, pause))
        except BaseException as fault:
            self.faults.append(fault)

    def kill(self):
        """Kill the server, at times with all that it started, and start it again."""
        left = psutil.Process(self.server.process.pid).children(recursive=True)
        self.server.process.kill()
        self.server.process.wait()
        for each in left if self.chance.random() < 0.7 else ():
            with suppress(psutil.NoSuchProcess):
                each.kill()
        self.server = Served(self.folder, "--workers", "1", port=self.server.port).wait()


@pytest.mark.parametrize("seed", range(STORMS))
def test_storm_of_signatures(seed, tmp_path):
    """No signed campaign changes, and nothing that was acknowledged as signed or withdrawn is lost."""
    storm = Storm(tmp_path, seed)
    try:
        storm.settle()
        acts = (storm.sign, 0.2), (storm.meddle, 1.0)
        threads = [threading.Thread(target=storm.repeat, args=each) for each in acts]
        for thread in threads:
            thread.start()
        for _ in range(KILLS):  # each in the midst of what is asked then
            due = sum(storm.counts.values()) + storm.chance.randint(3, 12)
            until(lambda due=due: sum(storm.counts.values()) >= due or storm.faults, storm.server.said, pause=0.001)
            storm.kill()
        until(lambda: len(storm.signed) >= SIGNATURES or storm.faults, storm.server.said)
        storm.over.set()
        for thread in threads:
            thread.join(PATIENCE)
        assert not storm.faults, f"{storm.faults}\n{storm.server.said()}"
        print(storm.counts)
        _check(storm)
    finally:
        storm.over.set()
        for person in (storm.approver, storm.meddler, storm.looker):
            person.leave()
        with storm.server:
            pass
    database = Database(storm.server.data / DATABASE)
    try:
        assert [row[0] for row in database.rows("PRAGMA integrity_check")] == ["ok"]
        assert AuditTrail(database).first_fault() is None
    finally:
        database.close()


def _check(storm):
    """Check the documents of each campaign, and that the last one, if it is a sign-off, is of the files as they are."""
    database = Database(storm.server.data / DATABASE)
    try:
        kept = [read_document(row["document"].encode()) for row in database.rows("SELECT document FROM signoffs")]
    finally:
        database.close()
    documents = {(each.campaign, each.comment): each.model_dump(mode="json") for each in kept}
    for key, document in storm.signed.items():
        assert documents.get(key) == document, (key, storm.counts)
    withdrawn = sum(isinstance(each, Withdrawal) for each in kept)
    assert withdrawn >= storm.counts.get(("withdraw", 200), 0) + storm.counts.get(("withdraw", 201), 0)
    for campaign in storm.texts:
        of_it = [each for each in kept if each.campaign == campaign]
        if not of_it or not isinstance(of_it[-1], Signoff):
            continue
        listed = storm.looker.ask("GET", f"{API}/{campaign}/signoffs", params={"check": True})
        assert listed.status_code == 200, listed.text
        assert listed.json()["status"] == "signed", listed.json()["signoffs"][-1]
        with pytest.raises(CampaignError):
            request_rerun(storm.store, campaign, [], "somebody")
        export = storm.looker.ask("GET", f"{API}/{campaign}/signoffs/export.zip")
        path = storm.folder / f"{campaign}.zip"
        path.write_bytes(export.content)
        assert verify_export(open_archive(path)).faults == []
