"""Each call of docs/examples/api.sh about people and trust does what it says, and the page shows calls of that file."""

import re
import shlex
from pathlib import Path
from string import Template

import pytest

from clearcap.web.access import Role
from clearcap.web.api import routers

DOCS = Path(__file__).parents[3] / "docs"
CALLS = (DOCS / "examples" / "api.sh").read_text("utf-8")
ONLY_IN_A_BROWSER = {
    ("PUT", "/api/v1/account/password"),
    ("POST", "/api/v1/tokens"),
    ("POST", "/api/v1/users"),
    ("POST", "/api/v1/users/bob/login-link"),
}
HEADINGS = ("Users, tokens and the audit trail", "Shared links", "Sign-off")


def commands(heading):
    """Return the words of each curl of a section."""
    section = CALLS.split(f"## {heading}\n")[1].split("\n## ")[0]
    return [line for line in section.splitlines() if line.startswith("curl ")]


def ask(client, line, known):
    """Send what a curl sends."""
    words = shlex.split(Template(line).safe_substitute(known))[1:]
    headers, method, body, url = {}, None, None, None
    while words:
        word = words.pop(0)
        if word == "-H":
            name, _, value = words.pop(0).partition(": ")
            headers[name] = value
        elif word == "-X":
            method = words.pop(0)
        elif word == "--json":
            body = words.pop(0)
            headers["Content-Type"] = "application/json"
        elif word == "-o":
            words.pop(0)
        else:
            url = word
    return client.request(method or ("POST" if body else "GET"), url, headers=headers, content=body)


@pytest.mark.parametrize("heading", HEADINGS)
def test_calls(client, service, as_user, signable, heading):
    """One after the other, as an admin."""
    service.users.add("bob", Role.VIEWER)
    auth = f"Authorization: {as_user('admin')['Authorization']}"
    known = {"AUTH": auth, "URL": "https://localhost", "ID": signable}
    lines = commands(heading)
    assert len(lines) > 2
    for line in lines:
        answer = ask(client, line, known)
        assert answer.status_code < 300, (line, answer.text)
        if line.endswith('/content"'):
            known["CONTENT"] = answer.json()["content"]
        if line.endswith('/tokens/1" -X DELETE'):  # that was this one
            known["AUTH"] = f"Authorization: {as_user('admin')['Authorization']}"


def test_every_call_is_shown():
    """With its method and path, but for those that give access, which only a browser may."""
    shown = set()
    for line in (line for heading in HEADINGS for line in commands(heading)):
        words = shlex.split(line)
        method = words[words.index("-X") + 1] if "-X" in words else "POST" if "--json" in words else "GET"
        path = next(word for word in words if word.startswith("$URL")).removeprefix("$URL").partition("?")[0]
        shown.add((method, path))
    examples = {"campaign": "$ID", "name": "bob", "token": "1", "share": "1"}
    kinds = {"users", "account", "tokens", "audit", "shares", "sign-off"}
    calls = {
        (method, route.path.format(**examples))
        for router in routers()
        if kinds & set(router.tags)
        for route in router.routes
        for method in route.methods
    }
    assert len(calls) > 15
    assert calls - shown == ONLY_IN_A_BROWSER


def test_the_page_shows_calls_of_the_file():
    """Each curl of a block of the page is a line of it, which a test sends."""
    page = (DOCS / "service.md").read_text("utf-8")
    shown = [line for block in re.findall(r"^```sh\n(.*?)^```", page, re.M | re.S) for line in block.splitlines()]
    assert len(shown) > 3
    assert set(shown) <= set(CALLS.splitlines())
