"""The HTTP API: which call is which function of `clearcap.web.operations`; documents and streams have own modules."""

from fastapi import APIRouter

from clearcap.web.api import documents, questions, submissions  # noqa: F401  # they add their calls
from clearcap.web.api.calls import ROUTERS
from clearcap.web.http.problems import described
from clearcap.web.operations import campaigns, mechanisms, people, samples, signoffs, webhooks


def routers() -> list[APIRouter]:
    """Return the routers of all calls."""
    return list(ROUTERS.values())


_CAMPAIGN, _SAMPLE = "/campaigns/{campaign}", "/campaigns/{campaign}/samples/{sample}"
_404, _409, _404_409 = described(404), described(409), described(404, 409)
each = ROUTERS["mechanisms"]
each.get("/mechanisms")(mechanisms.list_mechanisms)
each.get("/mechanisms/{name}", responses=_404_409)(mechanisms.show_mechanism)
each.put("/mechanisms/{name}", responses=_409)(mechanisms.save)
each.post("/checks/mechanism", responses=_409)(mechanisms.check_mechanism)

each = ROUTERS["simulations"]
each.post("/simulations", responses=_404_409)(mechanisms.simulate)

each = ROUTERS["campaigns"]
each.get(_CAMPAIGN, responses=_404)(campaigns.show_campaign)
each.get(f"{_CAMPAIGN}/status", responses=_404)(campaigns.campaign_status)
each.post(f"{_CAMPAIGN}/cancel", responses=_404)(campaigns.cancel)
each.post(f"{_CAMPAIGN}/resume", responses=_404)(campaigns.resume)
each.post(f"{_CAMPAIGN}/rerun", responses=_404_409)(campaigns.rerun)
each.patch(f"{_CAMPAIGN}/labels", responses=_404_409)(campaigns.label)
each.delete(_CAMPAIGN, status_code=204, responses=_404_409)(campaigns.delete)

each = ROUTERS["reports"]
each.get(f"{_CAMPAIGN}/reports", responses=_404)(campaigns.report_files)
each.post(f"{_CAMPAIGN}/report", responses=_404_409)(campaigns.write_report)
each.post(f"{_CAMPAIGN}/comparisons/{{other}}", responses=_404_409)(campaigns.write_comparison)

each = ROUTERS["samples"]
each.get(_SAMPLE, responses=_404)(samples.show_sample)
each.post(f"{_SAMPLE}/replay", responses=_404_409)(samples.replay)

each = ROUTERS["users"]
each.get("/users")(people.list_users)
each.post("/users", status_code=201, responses=_409)(people.add_user)
each.patch("/users/{name}", responses=_404_409)(people.change_user)
each.delete("/users/{name}/access", status_code=204, responses=_404)(people.end_access)
each.post("/users/{name}/login-link", status_code=201, responses=_404_409)(people.make_login_link)

each = ROUTERS["account"]
each.get("/account")(people.show_account)
each.put("/account/password", status_code=204)(people.set_password)
each.delete("/account/sessions", status_code=204)(people.end_sessions)

each = ROUTERS["tokens"]
each.get("/tokens")(people.list_tokens)
each.post("/tokens", status_code=201, responses=_409)(people.add_token)
each.delete("/tokens/{token}", status_code=204, responses=_404)(people.revoke_token)

each = ROUTERS["audit"]
each.get("/audit")(people.list_audit)
each.get("/audit/check")(people.check_audit)

each = ROUTERS["shares"]
each.get(f"{_CAMPAIGN}/shares", responses=_404)(people.list_shares)
each.post(f"{_CAMPAIGN}/shares", status_code=201, responses=_404_409)(people.add_share)
each.delete(f"{_CAMPAIGN}/shares/{{share}}", status_code=204, responses=_404)(people.revoke_share)

each = ROUTERS["sign-off"]
each.get("/signing-key")(signoffs.show_signing_key)
each.get(f"{_CAMPAIGN}/signoffs", responses=_404)(signoffs.list_signoffs)
each.get(f"{_CAMPAIGN}/signoffs/content", responses=_404_409)(signoffs.show_content)
each.post(f"{_CAMPAIGN}/signoffs", status_code=201, responses=_404_409)(signoffs.sign_campaign)
each.post(f"{_CAMPAIGN}/signoffs/withdrawal", status_code=201, responses=_404_409)(signoffs.withdraw_signoff)

each = ROUTERS["webhooks"]
each.get("/webhooks")(webhooks.list_webhooks)
each.post("/webhooks", status_code=201, responses=_409)(webhooks.add_webhook)
each.get("/webhooks/{webhook}", responses=_404)(webhooks.show_webhook)
each.delete("/webhooks/{webhook}", status_code=204, responses=_404)(webhooks.remove_webhook)
