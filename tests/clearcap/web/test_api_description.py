"""What every call answers is what its description says, whatever it is asked: never a 5xx, nothing undocumented."""

import httpx2
import pytest
import schemathesis
from hypothesis import HealthCheck, given, seed, settings
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from clearcap.web.access import Role
from clearcap.web.settings import Limits, Settings
from tests.clearcap.web.conftest import URL, copy_store, serving
from tests.clearcap.web.routes import all_ways
from tests.each import each

pytestmark = [pytest.mark.slow, pytest.mark.processes]

WAYS = {str(way): way for way in all_ways() if way.route.include_in_schema}
CALLS = sorted(WAYS)
CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]
SEED = 17
SOUND, UNSOUND = GenerationMode.POSITIVE, GenerationMode.NEGATIVE
EXAMPLES = {"admin": {SOUND: 4, UNSOUND: 6}, "viewer": {SOUND: 2, UNSOUND: 2}}  # of a call
PARTS = {"viewer": {"Range": "bytes=0-9"}}  # an answer in part must be documented, too
HEADERS = "authorization", "cookie", "host", "content-length", "transfer-encoding"  # the test's own
KNOWN = {"name": "clearance_pendulum", "token": 1, "share": 1, "sample": 3}


@pytest.fixture(scope="module")
def described(finished_store, storage, tmp_path_factory):
    """Return the description of the API, a client, tokens by role, and the id of the campaign that there is."""
    runs, campaign = finished_store
    folder = tmp_path_factory.mktemp("described")
    copy_store(runs, address := storage(folder))
    limits = Limits(job_seconds=600.0, failures=10**6)  # a busy machine must not refuse what it has no time for
    with serving(Settings(address, folder / "data", processes=1, limits=limits)) as (service, client):
        client.timeout = 600.0
        tokens = {role.word: service.tokens.add(role.word, "test", role, 3600.0)[1] for role in Role}
        yield schemathesis.openapi.from_dict(client.app.openapi()), client, tokens, campaign


@pytest.mark.parametrize("role", EXAMPLES)
@pytest.mark.parametrize("method", sorted({call.split(" ")[0] for call in CALLS}))
def test_calls(method, role, described):
    """Sound and unsound questions, for what there is and for what there is not."""
    calls = [call for call in CALLS if call.startswith(f"{method} ")]
    each("call", calls)(_check_call)(role=role, described=described)


def _check_call(call, role, described):
    """Ask one call as a role."""
    schema, client, tokens, campaign = described
    method, path = call.split(" ")
    operation = schema[path][method]
    known = {name: value for name, value in {**KNOWN, "campaign": campaign}.items() if f"{{{name}}}" in path}
    is_looked_at = Role.of(role) >= WAYS[call].role  # by whoever may less nothing is looked at
    for paths in [known, None] if known else [None]:
        varies = _varies(operation, paths or {})
        for mode, most in EXAMPLES[role].items():
            if mode is UNSOUND and not varies:  # nothing can be wrong
                continue
            cases = operation.as_strategy(generation_mode=mode, path_parameters=paths)
            _ask_often(
                cases,
                most if varies and is_looked_at else 1,
                client,
                {"Authorization": f"Bearer {tokens[role]}", **PARTS.get(role, {})},
            )


def _varies(operation, paths):
    """Return whether a call with some parameters of its path has any other, so that its examples differ."""
    others = [other for other in operation.path_parameters if other.name not in paths]
    return any([*others, *operation.query, *operation.headers, *operation.body])


def _ask_often(cases, count, client, own):
    """Ask with some cases and headers of one's own, and check each answer."""

    @seed(SEED)
    @settings(max_examples=count, database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(case=cases)
    def ask(case):
        sent = case.as_transport_kwargs(base_url=URL)
        headers = {name: value for name, value in sent["headers"].items() if name.lower() not in HEADERS}
        body = {"content": sent["data"]} if isinstance(sent.get("data"), bytes | str) else {"data": sent.get("data")}
        if "json" in sent:
            body = {"json": sent["json"]}
        headers |= own
        try:
            answer = client.request(sent["method"], sent["url"], params=sent.get("params"), headers=headers, **body)
        except httpx2.InvalidURL:  # longer than the client sends
            return
        case.validate_response(answer, checks=CHECKS)

    ask()
