"""Conversion of a server's refusals to clearcap's errors, with the server's message."""

from typing import TYPE_CHECKING, Any

from campaign.errors import CampaignError, SpecError, StoreError

if TYPE_CHECKING:
    import httpx

    from engine.faults.fault import Fault

LONGEST_DETAIL = 20_000  # characters
MOST_FAULTS = 100


def error_of(address: str, response: "httpx.Response") -> CampaignError:
    """Return the error for an answer with a status of 300 or more, whose body was read.

    It is SpecError for an invalid request, with the faults of a file; StoreError if the server or its store cannot
    answer now; CampaignError if the state of a campaign does not allow the request, or for too many requests.
    """
    status, problem = response.status_code, _problem(response)
    detail = str(problem.get("detail") or f"answered with status {status}")[:LONGEST_DETAIL]
    message = f"server {address}: {detail}"
    if status == 401:
        message += "; a token may have expired, or may have been revoked: make another on the server's page Account"
    if 300 <= status < 400:
        message += "; it sends to another address, which gets no token: name that address if you trust it"
    if status >= 500:
        return StoreError(message)
    if status in (409, 429):
        return CampaignError(message)
    return SpecError(message, _faults(problem.get("faults")))


def _problem(response: "httpx.Response") -> dict[str, Any]:
    """Return the problem details of an answer; an empty dict if it has none."""
    try:
        document = response.json()
    except ValueError:  # the answer of a proxy or of another kind of server
        return {}
    return document if isinstance(document, dict) else {}


def _faults(listed: Any) -> "list[Fault]":
    """Return the faults of problem details; entries of another form are left out."""
    tables = [each for each in listed if isinstance(each, dict)] if isinstance(listed, list) else []
    if not tables:
        return []
    from engine.faults.fault import Fault  # imported here, because it loads the engine

    return [
        Fault(
            tuple(map(str, table.get("keys") or ())),
            str(table.get("text", "")),
            value=table.get("value"),
            line=table["line"] if isinstance(table.get("line"), int) else None,
        )
        for table in tables[:MOST_FAULTS]
    ]
