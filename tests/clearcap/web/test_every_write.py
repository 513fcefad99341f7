"""Every route that writes, asked once so that it succeeds: the audit trail has who asked, what was done, to what."""

import re
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import count

import pytest

from campaign.coordinator.state import write_state
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store.drawing_library import Draft, read_draft
from campaign.store.labels import read_labels
from clearcap.questions.step_import import import_into_store
from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE, CSRF_FIELD, CSRF_HEADER
from clearcap.web.operations.mechanisms import shipped_text
from clearcap.web.pages.new_campaign import digest, tables_of
from clearcap.web.settings import Settings
from engine import simulate
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.clearcap.web.conftest import PASSWORD, URL, serving, write_real_report
from tests.clearcap.web.routes import all_ways
from tests.engine.mechanism.geometry.latch_file import LATCH

WRITES = {str(way): way for way in all_ways() if way.is_write}
TEXT = shipped_text("clearance_pendulum").decode()
OTHER = "another sentence that is long"
COSTS = "".join(f"[variables.{name}]\ncost = 1.0\n" for name in ("J1", "preload"))


@dataclass
class Call:
    """A request that succeeds.

    Attributes
    ----------
    path : dict
        Parameters of the path.
    sent : dict
        Body and headers, as of httpx.
    who : str
        Who asks: the name of a user's role, or of the user.
    """

    path: dict = field(default_factory=dict)
    sent: dict = field(default_factory=dict)
    who: str = "admin"

    @property
    def subject(self):
        """What the audit trail calls what it is done to."""
        return " ".join(map(str, self.path.values()))


class World:
    """A service with one computing process, and what its writes need.

    Parameters
    ----------
    service, client
        As of `serving`.
    folder : Path
        For campaign files.
    """

    def __init__(self, service, client, folder):
        self.service, self.client, self._folder, self._numbers = service, client, folder, count(1)

    def spec(self):
        """Return the text of a campaign that the store has not."""
        return SPEC.replace('"demo"', f'"demo{next(self._numbers)}"')

    def _loaded(self, samples=25):
        return load_campaign(self._file(), samples=samples)

    def _file(self):
        file = self._folder / f"{next(self._numbers)}.toml"
        file.write_text(self.spec())
        return str(file)

    def campaign(self, state="completed"):
        """Return the id of a new campaign without rows, in a state."""
        plan = submit(self.service.store, self._loaded(), 10)
        write_state(self.service.store, plan.campaign_id, state)
        self.service.watcher.hurry()
        return plan.campaign_id

    def computed(self, simulate, samples=25):
        """Return the id of a new campaign with its rows."""
        store, plan = computed(self.service.settings.store, self._loaded(samples), 10, simulate)
        write_state(store, plan.campaign_id, "completed")
        self.service.watcher.hurry()
        return plan.campaign_id

    @cached_property
    def finished(self):
        """The id of a campaign with rows."""
        return self.computed(fake_engine.simulate)

    @cached_property
    def other(self):
        """The id of another campaign with rows, and a report: it will be signed."""
        campaign = self.computed(fake_engine.simulate)
        write_real_report(self.service, campaign)
        return campaign

    @cached_property
    def seeds(self):
        """The ids of two campaigns with rows that differ in their seeds."""
        file = self._file()
        each = [computed(self.service.settings.store, load_campaign(file, seed=seed), 10) for seed in (1, 2)]
        self.service.watcher.hurry()
        return [plan.campaign_id for _, plan in each]

    @cached_property
    def real(self):
        """The id of a campaign that the engine has computed."""
        return self.computed(simulate, samples=1)

    @cached_property
    def failing(self):
        """The id of a campaign with failed rows."""
        return self.computed(partial(fake_engine.raises_above, 0.08))

    def user(self):
        """Return the name of a new viewer."""
        name = f"user{next(self._numbers)}"
        self.service.users.add(name, Role.VIEWER)
        return name

    def token(self):
        """Return the number of a new token of the admin's."""
        return self.service.tokens.add("admin", "test", Role.VIEWER, 3600.0)[0].id

    def shared(self):
        """Return the path of a new link to a campaign."""
        campaign = self.campaign()
        return {"campaign": campaign, "share": self.service.tokens.share(campaign, "admin", "", 3600.0)[0].id}

    def parts(self):
        """Return the files of measured parts that the store has not."""
        rows = "\n".join(["d", *(f"{20 + row % 7 / 1000 + next(self._numbers) / 1e6:.6f}" for row in range(30))])
        limits = '[characteristics.d]\nunit = "mm"\nlsl = 19.0\nusl = 21.0\n'
        return {"file": ("parts.csv", rows.encode()), "limits": ("limits.toml", limits.encode())}

    def measured_inputs(self):
        """Return the file of measured parts with a column of a variable."""
        rows = "\n".join(["J1", *(f"{0.07 + 0.0002 * (7 * row % 61 - 30):.4f}" for row in range(61))])
        return {"file": ("night.csv", rows.encode())}

    def measured(self):
        """Return the id of new measured parts of the engineer's."""
        call = Call({}, {"files": self.parts()}, "engineer")
        return self.ask(WRITES["POST /api/v1/measured"], call).json()["id"]

    def webhook(self):
        """Return the number of a new webhook of the admin's."""
        return self.ask(WRITES["POST /api/v1/webhooks"], HOW["POST /api/v1/webhooks"](self)).json()["webhook"]["id"]

    def content(self, campaign):
        """Return the digest of what would be signed."""
        answer = self.client.get(f"/api/v1/campaigns/{campaign}/signoffs/content", headers=self.browser("approver"))
        return answer.json()["content"]

    def browser(self, user):
        """Return the headers of a page that a user has open."""
        secret = self.service.sessions.begin(user)
        self.client.cookies.clear()
        self.client.cookies.set(COOKIE, secret)
        self.csrf = self.service.sessions.principal(secret).csrf
        return {"Origin": URL, "Sec-Fetch-Site": "same-origin", CSRF_HEADER: self.csrf}

    def ask(self, way, call):
        """Ask once, as a page does."""
        headers = self.browser(call.who)
        if not way.path.startswith("/api/"):  # the forms of pages have the word of the session as a field
            del headers[CSRF_HEADER]
            call.sent.setdefault("data", {})[CSRF_FIELD] = self.csrf
        headers |= call.sent.pop("headers", {})
        return self.client.request(way.method, way.url(**call.path), headers=headers, **call.sent)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """Return the world of all tests here."""
    folder = tmp_path_factory.mktemp("every-write")
    settings = Settings(str(folder / "runs"), folder / "data", processes=1, webhook_hosts=("127.0.0.1",))
    with serving(settings) as (service, client):
        service.users.change("viewer", password=PASSWORD)
        yield World(service, client, folder)


def of_finished(w, **sent):
    """Return a call about the finished campaign."""
    return Call({"campaign": w.finished}, sent)


def pooled(w, **sent):
    """Return the request for one report of two campaigns."""
    return Call({"campaign": w.seeds[0]}, sent)


def of_new(state, w, **sent):
    """Return a call about a campaign of its own in a state."""
    return Call({"campaign": w.campaign(state)}, sent)


def labelled(w):
    """Return a change of the labels that are there."""
    campaign = w.campaign()
    version = read_labels(w.service.store, campaign).version
    return Call({"campaign": campaign}, {"data": {"version": str(version), "note": "seen"}})


def deleted(w, form):
    """Return the deletion of a campaign."""
    campaign = w.campaign("cancelled")
    sent = {"data": {"confirm": campaign}} if form else {"headers": {"X-Confirm": campaign}}
    return Call({"campaign": campaign}, sent)


def signed(w, how):
    """Return a signature."""
    return Call({"campaign": w.other}, {how: {"content": w.content(w.other), "comment": "as drawn"}}, "approver")


def withdrawn(w, how):
    """Return the withdrawal of a signature that is there."""
    wanted = {"content": w.content(w.other), "comment": "to be withdrawn"}  # first: it begins a session of its own
    answer = w.client.post(f"/api/v1/campaigns/{w.other}/signoffs", headers=w.browser("approver"), json=wanted)
    assert answer.status_code == 201
    return Call({"campaign": w.other}, {how: {"comment": "wrong drawing"}}, "approver")


def failed_again(w):
    """Return the request to compute failed rows again."""
    write_state(w.service.store, w.failing, "completed")
    return Call({"campaign": w.failing}, {"json": {}})


def submitted(w):
    """Return the form of a new campaign of which only the text was changed."""
    return Call({}, {"data": {"text": w.spec(), "form-was": digest(tables_of({})), "action": "submit"}}, "engineer")


def with_password(w, sent):
    """Return a call of a user who has a password."""
    name = w.user()
    w.service.users.change(name, password=PASSWORD)
    return Call({}, sent, name)


def drafted(w, how):
    """Return a call that sends the text of a draft that is there."""
    store = w.service.store
    if read_draft(store, "latch") is None:
        import_into_store(store.files.full_url, Draft("latch", "", "latch.step", "", "", "engineer"), LATCH)
    draft = read_draft(store, "latch")
    return Call({"name": "latch"}, {how: {"text": draft.text, "version": draft.version}}, "engineer")


CHANGED = {"password": OTHER, "present": PASSWORD}
COMPUTING = re.compile("campaign|drawing|mechanism|simulation|measured")
STEP = {"file": ("latch.step", LATCH.read_bytes())}
KEPT = {"text": TEXT, "action": "save", "save_as": "kept"}
HOW = {
    "PUT /api/v1/mechanisms/{name}": lambda w: Call({"name": "mine"}, {"json": {"text": TEXT}}, "engineer"),
    "POST /api/v1/drawings": lambda w: Call({}, {"data": {"name": "drawn"}, "files": STEP}, "engineer"),
    "PUT /api/v1/drawings/{name}": lambda w: drafted(w, "json"),
    "POST /api/v1/drawings/{name}/check": lambda w: drafted(w, "json"),
    "POST /api/v1/drawings/{name}/groups": lambda w: drafted(w, "json"),
    "POST /api/v1/drawings/{name}/mechanism": lambda w: drafted(w, "json"),
    "POST /mechanisms/drawings": lambda w: Call({}, {"data": {"name": "formed"}, "files": STEP}, "engineer"),
    "POST /mechanisms/{name}/drawing": lambda w: drafted(w, "data"),
    "POST /api/v1/measured": lambda w: Call({}, {"files": w.parts()}, "engineer"),
    "DELETE /api/v1/measured/{measured}": lambda w: Call({"measured": w.measured()}, {}, "engineer"),
    "POST /api/v1/campaigns/{campaign}/monitor": lambda w: of_finished(w, files=w.measured_inputs()),
    "POST /measured": lambda w: Call({}, {"files": w.parts()}, "engineer"),
    "POST /measured/{measured}/delete": lambda w: Call({"measured": w.measured()}, {}, "engineer"),
    "POST /api/v1/checks/mechanism": lambda w: Call({}, {"json": {"text": TEXT}}, "engineer"),
    "POST /api/v1/simulations": lambda w: Call({}, {"json": {"mechanism": "incline"}}, "engineer"),
    "POST /api/v1/checks/campaign": lambda w: Call({}, {"json": {"text": SPEC}}, "engineer"),
    "POST /api/v1/campaigns": lambda w: Call({}, {"json": {"text": w.spec()}}, "engineer"),
    "POST /api/v1/campaigns/{campaign}/extend": lambda w: of_finished(w, json={"samples": 40}),
    "POST /api/v1/campaigns/{campaign}/cancel": partial(of_new, "queued"),
    "POST /api/v1/campaigns/{campaign}/resume": partial(of_new, "cancelled"),
    "POST /api/v1/campaigns/{campaign}/rerun": failed_again,
    "PATCH /api/v1/campaigns/{campaign}/labels": lambda w: of_new("queued", w, json={"note": "seen"}),
    "DELETE /api/v1/campaigns/{campaign}": lambda w: deleted(w, form=False),
    "POST /api/v1/campaigns/{campaign}/report": of_finished,
    "POST /api/v1/campaigns/{campaign}/comparisons/{other}": lambda w: Call({"campaign": w.finished, "other": w.other}),
    "POST /api/v1/campaigns/{campaign}/pools": lambda w: pooled(w, json={"others": w.seeds[1:]}),
    "POST /api/v1/campaigns/{campaign}/whatif": lambda w: of_finished(w, json={"set": ["J1.std=0.015"]}),
    "POST /api/v1/campaigns/{campaign}/allocation": lambda w: of_finished(w, json={"costs": COSTS}),
    "POST /api/v1/campaigns/{campaign}/confirmation": lambda w: of_finished(w, json={"costs": COSTS}),
    "POST /api/v1/campaigns/{campaign}/samples/{sample}/replay": lambda w: Call({"campaign": w.real, "sample": 0}),
    "POST /api/v1/users": lambda w: Call({}, {"json": {"name": "eva", "role": "engineer"}}),
    "PATCH /api/v1/users/{name}": lambda w: Call({"name": w.user()}, {"json": {"role": "engineer"}}),
    "POST /api/v1/users/{name}/login-link": lambda w: Call({"name": w.user()}),
    "DELETE /api/v1/users/{name}/access": lambda w: Call({"name": w.user()}),
    "PUT /api/v1/account/password": lambda w: with_password(w, {"json": CHANGED}),
    "DELETE /api/v1/account/sessions": lambda w: Call({}, {}, w.user()),
    "POST /api/v1/tokens": lambda w: Call({}, {"json": {"name": "night", "role": "viewer"}}, "viewer"),
    "DELETE /api/v1/tokens/{token}": lambda w: Call({"token": w.token()}),
    "POST /api/v1/campaigns/{campaign}/shares": lambda w: of_new("queued", w, json={"days": 7}),
    "DELETE /api/v1/campaigns/{campaign}/shares/{share}": lambda w: Call(w.shared()),
    "POST /api/v1/campaigns/{campaign}/signoffs": lambda w: signed(w, "json"),
    "POST /api/v1/campaigns/{campaign}/signoffs/withdrawal": lambda w: withdrawn(w, "json"),
    "POST /api/v1/webhooks": lambda w: Call({}, {"json": {"url": "http://127.0.0.1:9/clearcap"}}),
    "DELETE /api/v1/webhooks/{webhook}": lambda w: Call({"webhook": w.webhook()}),
    "POST /login": lambda w: Call({}, {"data": {"name": "viewer", "password": PASSWORD}}, "viewer"),
    "POST /login/link": lambda w: Call({}, {"data": {"key": w.service.sessions.new_link("viewer")}}, "viewer"),
    "POST /logout": lambda w: Call({}, {}, w.user()),
    "POST /account/tokens": lambda w: Call({}, {"data": {"name": "night", "role": "viewer"}}, "viewer"),
    "POST /account/tokens/{token}/revoke": lambda w: Call({"token": w.token()}),
    "POST /account/password": lambda w: with_password(w, {"data": {**CHANGED, "again": OTHER}}),
    "POST /account/sessions/end": lambda w: Call({}, {}, w.user()),
    "POST /admin/users": lambda w: Call({}, {"data": {"name": "bob", "role": "viewer"}}),
    "POST /admin/users/{name}/role": lambda w: Call({"name": w.user()}, {"data": {"role": "engineer"}}),
    "POST /admin/users/{name}/disabled": lambda w: Call({"name": w.user()}, {"data": {"disabled": "true"}}),
    "POST /admin/users/{name}/password": lambda w: Call({"name": w.user()}, {"data": {"password": OTHER}}),
    "POST /admin/users/{name}/access": lambda w: Call({"name": w.user()}),
    "POST /admin/users/{name}/link": lambda w: Call({"name": w.user()}),
    "POST /admin/tokens/{token}/revoke": lambda w: Call({"token": w.token()}),
    "POST /mechanisms": lambda w: Call({}, {"data": {"name": "sent"}, "files": {"file": ("x.toml", TEXT.encode())}}),
    "POST /mechanisms/{name}/edit": lambda w: Call({"name": "incline"}, {"data": KEPT}),
    "POST /campaigns/new": submitted,
    "POST /campaigns/{campaign}/report": of_finished,
    "POST /campaigns/{campaign}/cancel": partial(of_new, "queued"),
    "POST /campaigns/{campaign}/resume": partial(of_new, "cancelled"),
    "POST /campaigns/{campaign}/rerun": failed_again,
    "POST /campaigns/{campaign}/extend": lambda w: of_finished(w, data={"samples": "50"}),
    "POST /campaigns/{campaign}/labels": labelled,
    "POST /campaigns/{campaign}/delete": lambda w: deleted(w, form=True),
    "POST /campaigns/{campaign}/samples/{sample}/replay": lambda w: Call({"campaign": w.real, "sample": 0}),
    "POST /campaigns/{campaign}/compare": lambda w: of_finished(w, data={"with": w.other}),
    "POST /campaigns/{campaign}/whatif/confirm": lambda w: of_finished(w, data={"costs": COSTS}),
    "POST /campaigns/{campaign}/monitor": lambda w: of_finished(w, files=w.measured_inputs()),
    "POST /campaigns/{campaign}/pool": lambda w: pooled(w, data={"others": w.seeds[1:]}),
    "POST /campaigns/{campaign}/share": lambda w: of_new("queued", w, data={"days": "7"}),
    "POST /campaigns/{campaign}/share/{share}/revoke": lambda w: Call(w.shared()),
    "POST /campaigns/{campaign}/signoff": lambda w: signed(w, "data"),
    "POST /campaigns/{campaign}/signoff/withdraw": lambda w: withdrawn(w, "data"),
}  # fmt: skip


def test_each_write_is_asked_here():
    """A new one needs a call that succeeds; one that is gone is no longer listed."""
    assert set(HOW) == set(WRITES)


def marked(name):
    """Return a route; slow where a campaign or a process that computes is needed."""
    return pytest.param(name, marks=pytest.mark.slow) if COMPUTING.search(name) else name


@pytest.mark.processes
@pytest.mark.parametrize("name", [marked(name) for name in WRITES])
def test_success_is_audited(name, world):
    """One entry says who, from a session, what, to what, and that it was done; no secret of the answer is in it."""
    call = HOW[name](world)
    before = max((entry.number for entry in world.service.audit.newest(count=1)), default=0)
    answer = world.ask(WRITES[name], call)
    assert answer.status_code < 400, answer.text
    (entry,) = [entry for entry in world.service.audit.newest() if entry.number > before]
    how = {"POST /login": "password", "POST /login/link": "link"}.get(name, "session")
    assert (entry.who, entry.how, entry.address) == (call.who, how, "testclient")
    assert (entry.action, entry.object, entry.status) == (name, call.subject, answer.status_code)
    assert PASSWORD not in entry.detail
    assert OTHER not in entry.detail
    assert "clearcap_" not in entry.detail


@pytest.mark.processes
def test_trail_is_whole(world):
    """After all of these the digests follow each other, and an admin is told so."""
    assert world.client.get("/api/v1/audit/check", headers=world.browser("admin")).json()["whole"] is True
