"""A browser without scripts, on the pages of a service with a computing process."""

import pytest

from clearcap.web.http.authentication import COOKIE
from tests.clearcap.web.conftest import URL
from tests.clearcap.web.pages.forms import Page


@pytest.fixture
def visit(computing_service):
    """Return what opens a page as a user of a role, checks what every page must be, and returns the answer."""
    service, client = computing_service
    client.cookies.clear()

    def opened(path, role="engineer", status=200, **options):
        client.cookies.set(COOKIE, service.sessions.begin(role))
        answer = client.get(path, headers={"Accept": "text/html", **options.pop("headers", {})}, **options)
        client.cookies.clear()
        assert answer.status_code == status, answer.text
        if status == 200:
            assert Page(answer.text).faults == []
        return answer

    return opened


@pytest.fixture
def submit(computing_service):
    """Return what submits a form of a page as a user of a role, and returns the answer."""
    service, client = computing_service

    def sent(action, role="engineer", **fields):
        secret = service.sessions.begin(role)
        client.cookies.set(COOKIE, secret)
        data = {**fields, "csrf": service.sessions.principal(secret).csrf}
        answer = client.post(action, data=data, headers={"Origin": URL, "Accept": "text/html"})
        client.cookies.clear()
        return answer

    return sent
