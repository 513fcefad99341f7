"""Hostile names in every field and every path: never a 5xx, and no page contains them as they are."""

import json
from urllib.parse import quote

import pytest
from fastapi.routing import APIRoute

from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE, CSRF_HEADER
from clearcap.web.settings import Limits, Settings
from tests.clearcap.web.conftest import URL, copy_store, serving
from tests.clearcap.web.routes import all_ways
from tests.each import each

pytestmark = [pytest.mark.slow, pytest.mark.processes]

MARKUP = "<script>alert(1)</script>"
NAMES = {
    "markup": MARKUP,
    "attribute": '"\' onmouseover=alert(1) x="<b>',
    "template": "{{ 'seven' ~ 'teen' }}{% raw %}<i>",
    "right to left": "\u202e\u2066gnp.exe<i>",
    "nul": "a\0b<i>",
    "surrogate": "\ud800<i>",
    "long": "<i>" * 3334,
    "traversal": "../../../../etc/passwd",
    "encoded traversal": "..%2f..%2fetc%2fpasswd%00",
    "lines": "a\r\nSet-Cookie: evil=1\r\n\r\n<i>",
}
WAYS = {str(way): way for way in all_ways()}
WITH_PATHS = [name for name, way in WAYS.items() if way.route.param_convertors]
FORMS = [name for name, way in WAYS.items() if way.is_write and not way.path.startswith("/api/")]
BODIES = [name for name, way in WAYS.items() if way.is_write and way.path.startswith("/api/") and way.route.body_field]
PAGES = [name for name, way in WAYS.items() if not way.path.startswith("/api/") and way.method == "GET"]
ENDING = {"POST /logout", "PUT /api/v1/account/password", "POST /account/password", "POST /account/sessions"}


@pytest.fixture(scope="module")
def open_to_all(finished_store, storage, tmp_path_factory):
    """Return what asks a way as an admin's program or browser, and the id of the campaign that there is."""
    runs, campaign = finished_store
    folder = tmp_path_factory.mktemp("hostile-names")
    copy_store(runs, address := storage(folder))
    limits = Limits(job_seconds=600.0, failures=10**6)  # a busy machine must not refuse what it has no time for
    with serving(Settings(address, folder / "data", processes=1, limits=limits)) as (service, client):
        _, token = service.tokens.add("admin", "test", Role.ADMIN, 3600.0)

        def ask(way, *, path=None, body=None, form=None, query=None):
            url = path or way.url(campaign=campaign, user="viewer", name="viewer")
            if not way.path.startswith("/api/"):
                secret = service.sessions.begin("admin")
                headers = {CSRF_HEADER: service.sessions.principal(secret).csrf, "Cookie": f"{COOKIE}={secret}"}
                headers |= {"Origin": URL, "Accept": "text/html"}
            else:
                headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
            content = None if body is None else json.dumps(body).encode()
            return client.request(way.method, url, headers=headers, content=content, data=form, params=query)

        yield ask, service, campaign


def _check(answer):
    """Check that an answer is no failure, has no header of the asker's, and shows no markup of his."""
    assert answer.status_code < 500, answer.text
    assert "evil" not in str(answer.headers.get("set-cookie", ""))
    if answer.headers.get("content-type", "").startswith("text/html"):
        shown = answer.text
        assert MARKUP not in shown
        assert "<i>" not in shown
        assert 'onmouseover=alert(1) x="' not in shown
        assert "seventeen" not in shown, "the template of a name was run"
    assert "root:x:0" not in answer.text


def _quoted(name):
    return quote(name.encode(errors="surrogatepass"), safe="")


@each("name", WITH_PATHS)
def test_in_paths(name, open_to_all):
    """Each parameter of each path."""
    ask, _, campaign = open_to_all
    way = WAYS[name]
    for hostile in NAMES.values():
        for parameter in way.route.param_convertors:
            _check(ask(way, path=way.url(**{"campaign": campaign, parameter: _quoted(hostile)})))


@each("name", [name for name, way in WAYS.items() if way.method == "GET"])
def test_in_questions(name, open_to_all):
    """Each parameter behind the question mark."""
    ask, _, _ = open_to_all
    way = WAYS[name]
    fields = _flat(way.route, "query_params")
    for hostile in NAMES.values():
        for field in fields:
            if not (field == "check" or hostile.startswith("\ud800")):
                _check(ask(way, query={field: hostile}))


@each("name", [name for name in FORMS if name not in ENDING])
def test_in_forms(name, open_to_all):
    """Each field of each form, then all of them."""
    ask, _, _ = open_to_all
    way = WAYS[name]
    fields = _flat(way.route, "body_params")
    for hostile in NAMES.values() if fields else [""]:
        if not hostile.startswith("\ud800"):
            _check(ask(way, form=dict.fromkeys(fields, hostile)))
            for field in fields if len(fields) > 1 else []:
                _check(ask(way, form={field: hostile}))


@each("name", [name for name in BODIES if name not in ENDING])
def test_in_bodies(name, open_to_all):
    """Each text of each JSON body, those in lists and tables too."""
    ask, _, _ = open_to_all
    way = WAYS[name]
    schema = _schema(way.route)
    for hostile in NAMES.values():
        _check(ask(way, body=_filled(schema, schema, hostile)))
        _check(ask(way, body={hostile: hostile}))
    _check(ask(way, body=[[[]]]))


@each("name", PAGES)
def test_kept_names_are_shown_as_text(name, open_to_all):
    """What somebody wrote into labels, notes and names of tokens is text on every page, to an admin too."""
    ask, service, campaign = open_to_all
    for hostile in (MARKUP, NAMES["attribute"], NAMES["template"], NAMES["right to left"]):
        labels = {"note": hostile, "add_tags": [], "remove_tags": []}
        ask(WAYS["PATCH /api/v1/campaigns/{campaign}/labels"], body=labels)
        if not any(share.note == hostile for share in service.tokens.shares(campaign)):
            service.tokens.share(campaign, "engineer", hostile, 3600.0)
            service.tokens.add("admin", hostile, Role.VIEWER, 3600.0)
            service.audit.add(hostile, "none", hostile, hostile, hostile, 200, hostile)
        _check(ask(WAYS[name]))


def _flat(route: APIRoute, kind):
    """Return the names of all parameters of a kind, of models too."""
    names = []
    for field in getattr(route.dependant, kind):
        inner = getattr(field.field_info.annotation, "model_fields", None)
        names += list(inner) if inner else [field.alias]
    return names


def _schema(route):
    """Return the schema of the body of a call."""
    kind = route.body_field.field_info.annotation
    return kind.model_json_schema() if hasattr(kind, "model_json_schema") else {"type": "object"}


def _filled(schema, root, hostile):
    """Return what a schema describes, with a text wherever it allows one."""
    if "$ref" in schema:
        return _filled(root["$defs"][schema["$ref"].rpartition("/")[2]], root, hostile)
    for choice in ("anyOf", "oneOf", "allOf"):
        if choice in schema:
            return _filled(schema[choice][0], root, hostile)
    kind = schema.get("type", "string")
    if kind == "object":
        inner = {name: _filled(kept, root, hostile) for name, kept in schema.get("properties", {}).items()}
        return inner or {hostile: hostile}
    if kind == "array":
        return [_filled(schema.get("items", {}), root, hostile)]
    return {"integer": 1, "number": 1.0, "boolean": True}.get(kind, hostile)
