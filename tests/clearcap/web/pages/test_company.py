"""Log in with the company's account, against a small login service: what it may say, and what is refused."""

import base64
import dataclasses
import hashlib
import json
import logging
import time
from urllib.parse import parse_qs, urlsplit

import httpx2
import pytest
from joserfc import jwt
from joserfc.jwk import KeySet, OctKey, RSAKey

from clearcap.web.access import Role
from clearcap.web.access.company_login import CompanyLogin
from clearcap.web.access.throttle import place_of
from clearcap.web.http.authentication import COOKIE
from clearcap.web.pages.login import BEGUN
from clearcap.web.settings import Oidc
from tests.each import each

ISSUER = "https://id.example"
OIDC = Oidc(ISSUER, "clearcap", "the client's secret", roles={"tolerance": "engineer", "quality": "approver"})
KEY, OTHER_KEY = RSAKey.generate_key(2048, {"kid": "1"}), RSAKey.generate_key(2048, {"kid": "1"})


class Company:
    """A login service.

    Attributes
    ----------
    claims : dict
        What its next token says beyond what it must.
    sign : callable
        Makes the token of claims.
    answers : dict
        Answers by path that replace its own: status and document.
    """

    def __init__(self):
        self.claims, self.answers, self.asked = {}, {}, []
        self.sign = lambda claims: jwt.encode({"alg": "RS256", "kid": "1"}, claims, KEY)
        self.metadata = {
            "issuer": ISSUER,
            "authorization_endpoint": f"{ISSUER}/authorize",
            "token_endpoint": f"{ISSUER}/token",
            "jwks_uri": f"{ISSUER}/keys",
        }

    def log_in(self, url):
        """Log in there as a browser that was sent to `url`; return the parameters with which it is sent back."""
        self.wanted = {key: values[0] for key, values in parse_qs(urlsplit(url).query).items()}
        return {"code": "the-code", "state": self.wanted["state"]}

    def __call__(self, request):
        """Answer a request of the server."""
        path = request.url.path
        self.asked.append(path)
        if path in self.answers:
            status, document = self.answers[path]
            return httpx2.Response(status, json=document)
        if path == "/.well-known/openid-configuration":
            return httpx2.Response(200, json=self.metadata)
        if path == "/keys":
            return httpx2.Response(200, json=KeySet([KEY]).as_dict(private=False))
        assert path == "/token"
        form = {key: values[0] for key, values in parse_qs(request.content.decode()).items()}
        challenge = base64.urlsafe_b64encode(hashlib.sha256(form["code_verifier"].encode()).digest()).rstrip(b"=")
        assert challenge.decode() == self.wanted["code_challenge"]
        assert self.wanted["code_challenge_method"] == "S256"
        assert form["redirect_uri"] == self.wanted["redirect_uri"]
        if form["code"] != "the-code" or not request.headers["authorization"].startswith("Basic "):
            return httpx2.Response(400, json={"error": "invalid_grant"})
        now = int(time.time())
        claims = {"iss": ISSUER, "aud": "clearcap", "sub": "4711", "exp": now + 300, "iat": now}
        claims |= {"nonce": self.wanted["nonce"], "preferred_username": "eva", **self.claims}
        claims = {key: value for key, value in claims.items() if value is not None}
        return httpx2.Response(200, json={"access_token": "x", "token_type": "Bearer", "id_token": self.sign(claims)})


PLACE = f"company {place_of('testclient')}"  # whose failed logins are counted


@pytest.fixture
def settings(settings):
    return dataclasses.replace(settings, oidc=OIDC)


@pytest.fixture
def company(service):
    """Return the login service of a server."""
    made = Company()
    service.company = CompanyLogin(OIDC, service.settings.address, httpx2.MockTransport(made))
    return made


@pytest.fixture
def log_in(client, company):
    """Return what logs in from the first page to the last."""

    def done(next="/mechanisms", **changes):
        began = client.get("/login/company", params={"next": next})
        assert began.status_code == 303, began.text
        answer = company.log_in(began.headers["location"]) | changes
        # the browser comes from another site
        return client.get("/login/company/callback", params=answer, headers={"Sec-Fetch-Site": "cross-site"})

    return done


def test_first_login_makes_a_user(client, service, company, log_in):
    """The cookie that waits is lax, that of the session strict; the page goes on to what was wanted."""
    company.claims = {"groups": ["everyone", "tolerance"]}
    began = client.get("/login/company")
    assert "SameSite=lax" in began.headers["set-cookie"]
    assert began.headers["location"].startswith(f"{ISSUER}/authorize?")
    answer = log_in()
    assert 'content="0; url=/mechanisms"' in answer.text
    cookies = answer.headers.get_list("set-cookie")
    assert any(each.startswith(f"{COOKIE}=") and "SameSite=strict" in each for each in cookies)
    assert any(each.startswith(f'{BEGUN}=""') for each in cookies)
    assert service.sessions.principal(client.cookies[COOKIE]).role is Role.ENGINEER
    assert service.users.get("eva").role is Role.ENGINEER
    newest = service.audit.newest(count=1)[0]
    assert (newest.who, newest.how, newest.status) == ("eva", "company", 200)


def test_role_follows_the_groups(service, company, log_in):
    """At each login; the highest counts, and without a group he is a viewer."""
    for groups, role in (
        (["tolerance", "quality"], Role.APPROVER),
        ("tolerance", Role.ENGINEER),
        ([], Role.VIEWER),
        (None, Role.VIEWER),
        ([{"x": 1}, 7], Role.VIEWER),
    ):
        company.claims = {"groups": groups}
        log_in()
        assert service.users.get("eva").role is role
    assert len(service.users.all()) == len(Role) + 1


def test_name_is_no_proof(service, company, log_in):
    """Who is called as a user of this server, or is called nothing that can be a name, is another user."""
    company.claims = {"preferred_username": "admin"}
    log_in()
    assert service.users.get("admin-2").role is Role.VIEWER
    company.claims = {"preferred_username": "../<b>", "sub": "2"}
    log_in()
    assert service.users.get("-b-") is None
    assert service.users.get("b-") is not None
    company.claims = {"preferred_username": None, "sub": "3"}
    log_in()
    assert service.users.get("3") is not None


def test_disabled_user(service, company, log_in):
    log_in()
    service.users.change("eva", disabled=True)
    answer = log_in()
    assert (answer.status_code, "is disabled" in answer.text) == (403, True)


@each(
    "claims",
    [
        {"nonce": "another"},
        {"nonce": None},
        {"aud": "another"},
        {"aud": ["another", "more"]},
        {"aud": ["clearcap", "another"], "azp": "another"},
        {"aud": None},
        {"iss": "https://evil.example"},
        {"iss": None},
        {"exp": 1_000_000_000},
        {"exp": None},
        {"iat": 4_000_000_000},
        {"nbf": 4_000_000_000},
        {"sub": None},
        {"sub": ""},
        {"sub": 7},
        {"exp": "never"},
    ],
)
def test_wrong_claims(service, company, log_in, claims):
    """None of them proves who somebody is."""
    company.claims = claims
    answer = log_in()
    service.throttle.succeeded(PLACE)
    assert (answer.status_code, COOKIE in str(answer.headers.get_list("set-cookie"))) == (403, False)
    assert "identity token" in answer.json()["detail"]
    assert len(service.users.all()) == len(Role)


def unsigned(claims):
    parts = (json.dumps(part).encode() for part in ({"alg": "none"}, claims))
    return ".".join(base64.urlsafe_b64encode(part).rstrip(b"=").decode() for part in parts) + "."


@each(
    "sign",
    [
        unsigned,
        lambda claims: jwt.encode({"alg": "RS256", "kid": "1"}, claims, OTHER_KEY),
        lambda claims: jwt.encode({"alg": "HS256"}, claims, OctKey.import_key(OIDC.client_secret)),
        lambda claims: jwt.encode({"alg": "HS256", "kid": "1"}, claims, OctKey.import_key("public " * 9)),
        lambda claims: jwt.encode({"alg": "RS256", "kid": "2"}, claims, KEY),
        lambda claims: jwt.encode({"alg": "RS256", "kid": "1"}, claims, KEY)[:-8] + "AAAAAAAA",
        lambda claims: "no token",
        lambda claims: {"no": "token"},
    ],
)
def test_wrong_signature(service, company, log_in, sign):
    """Tokens that the service's own keys did not sign."""
    company.sign = sign
    answer = log_in()
    service.throttle.succeeded(PLACE)
    assert answer.status_code == 403
    assert "identity token" in answer.json()["detail"]
    assert len(service.users.all()) == len(Role)


@pytest.mark.parametrize(
    ("answer", "fault"),
    [
        ({"state": "another"}, "not the answer to the login"),
        ({"state": ""}, "not the answer to the login"),
        ({"state": "\udfff".encode("utf-8", "replace").decode()}, "not the answer to the login"),
        ({"code": ""}, "no code"),
        ({"code": "another"}, "does not accept its own answer"),
        ({"error": "access_denied"}, "refused: access_denied"),
        ({"error": "<script>"}, "refused: error"),
        ({"iss": "https://evil.example"}, "comes from another login service"),
    ],
)
def test_wrong_answer(company, log_in, answer, fault):
    answer = log_in(**answer)
    assert (answer.status_code, fault in answer.json()["detail"]) == (403, True)


def test_other_browser(client, company, log_in):
    """The answer to a login that another browser began, that nobody began, or that began long ago."""
    began = client.get("/login/company")
    answer = company.log_in(began.headers["location"])
    kept = client.cookies[BEGUN]
    for cookie in (None, "forged", kept[:-3] + "xyz"):
        client.cookies.clear()
        if cookie:
            client.cookies.set(BEGUN, cookie)
        refused = client.get("/login/company/callback", params=answer)
        assert (refused.status_code, "in another browser" in refused.json()["detail"]) == (403, True)
    client.cookies.set(BEGUN, kept)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("clearcap.web.access.company_login.LOGIN_WITHIN", -1)
        assert client.get("/login/company/callback", params=answer).status_code == 403
    assert "/token" not in company.asked


@pytest.mark.parametrize(
    ("path", "answer"),
    [
        ("/.well-known/openid-configuration", (500, {})),
        ("/.well-known/openid-configuration", (200, [])),
        ("/.well-known/openid-configuration", (200, {"issuer": "https://evil.example"})),
        ("/.well-known/openid-configuration", (200, {"issuer": ISSUER, "authorization_endpoint": "http://id.example"})),
        ("/.well-known/openid-configuration", (302, {})),
    ],
)
def test_service_that_does_not_answer(client, company, path, answer):
    """It is one clear message, and not the user's fault."""
    company.answers[path] = answer
    refused = client.get("/login/company", headers={"Accept": "text/html"})
    assert refused.status_code == 503
    assert "the login service" in refused.text


@pytest.mark.parametrize(("path", "status"), [("/token", 503), ("/keys", 503)])
def test_service_that_fails_later(company, log_in, path, status):
    company.answers[path] = (500, {})
    answer = log_in()
    assert answer.status_code in (403, status)
    assert "login service" in answer.json()["detail"]


def test_many_failures_are_slowed_down(company, log_in):
    statuses = [log_in(code="guess").status_code for _ in range(6)]
    assert statuses == [403] * 5 + [429]


def test_many_logins_are_not(company, log_in):
    assert [log_in().status_code for _ in range(7)] == [200] * 7


def test_login_leads_nowhere_else(company, log_in):
    assert 'url=/campaigns"' in log_in(next="https://evil.example").text


def test_server_without_company(client, service):
    service.company = None
    assert client.get("/login/company").status_code == 404
    assert client.get("/login/company/callback").status_code == 404


def test_nothing_secret_is_logged(client, company, log_in, caplog):
    """Neither of this server's secrets, nor of the login service's."""
    caplog.set_level(logging.DEBUG)
    tokens = []
    sign = company.sign
    company.sign = lambda claims: tokens.append(sign(claims)) or tokens[-1]
    log_in()
    log_in(code="another-code")
    secrets = [OIDC.client_secret, *tokens, *(company.wanted[key] for key in ("state", "nonce", "code_challenge"))]
    secrets += [client.cookies[COOKIE], client.cookies.get(BEGUN) or "nothing kept"]
    assert len(secrets) == 7
    # what the browser of this test logs of its own requests is not the server's
    lines = [line for line in caplog.text.splitlines() if "https://localhost/" not in line]
    assert [line for line in lines if any(secret in line for secret in secrets)] == []
    assert "clearcap.requests" in caplog.text
