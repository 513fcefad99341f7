"""Users, their tokens and sessions, the links they share, and the trail of what they did."""

from datetime import UTC, datetime
from typing import Annotated, Literal

from fastapi import Path, Query, Request
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from clearcap.web.access import Principal, Role
from clearcap.web.access.users import LINK_LIVES, LONGEST_PASSWORD, NAME, SHORTEST_PASSWORD, User
from clearcap.web.http.authentication import (
    CAMPAIGN_ID,
    Admin,
    Engineer,
    TheCampaign,
    TheService,
    Viewer,
    checked_user,
    lacks_role,
)
from clearcap.web.http.responses import Refusal
from clearcap.web.operations import Sent
from clearcap.web.web_service import Service
from clearcap.web.webhooks import LONGEST_URL, Webhook, target_addresses, webhook_target

RoleWord = Annotated[
    Literal["viewer", "engineer", "approver", "admin"], BeforeValidator(lambda role: getattr(role, "word", role))
]
UserName = Annotated[str, Path(max_length=100, description="Name of the user", examples=["eva"])]
Password = Annotated[
    str, Field(min_length=SHORTEST_PASSWORD, max_length=LONGEST_PASSWORD, examples=["a long sentence"])
]
ListedId = Annotated[int, Path(ge=0, le=2**53, examples=[1])]
Cursor = Annotated[int | None, Query(ge=0, le=2**53, description="From the page before")]
PageSize = Annotated[int, Query(ge=1, le=1000)]
MOST_TOKENS = 100  # valid tokens of a user
DAY = 24 * 3600.0  # s


class _Listed(BaseModel):
    """What a list shows of an object, without its secrets; a time in seconds since 1970 becomes a date."""

    model_config = ConfigDict(from_attributes=True)


class ListedUser(_Listed):
    """A user, without secrets."""

    name: str = Field(examples=["eva"])
    role: RoleWord = Field(examples=["engineer"])
    created: datetime = Field(examples=["2026-11-23T09:00:00Z"])
    is_disabled: bool = Field(description="The user can neither log in nor use tokens", examples=[False])
    has_password: bool = Field(examples=[True])


class UserList(BaseModel):
    """A page of the list of users, by name."""

    users: list[ListedUser]
    next: str | None = Field(description="Cursor of the next page; null on the last one", examples=[None])


class NewUser(Sent):
    """A user to be added."""

    name: str = Field(
        pattern=f"^{NAME.pattern}$", description="Letters, digits and . _ @ -, 64 characters at most", examples=["eva"]
    )
    role: RoleWord = Field(examples=["engineer"])
    password: Password | None = Field(None, description="Without one the user logs in by a link or the login service")


class UserChange(Sent):
    """A change of a user; fields that are left out stay unchanged."""

    role: RoleWord | None = Field(None, examples=["approver"])
    password: Password | None = Field(None, description="Ends all that `disabled` ends, but the user can log in")
    disabled: bool | None = Field(
        None, description="Ends the user's sessions, tokens, shared links and webhooks for good", examples=[False]
    )


class LoginLink(BaseModel):
    """A one-time login link of a user."""

    link: str = Field(examples=["http://127.0.0.1:8700/login/link?key=clearcap_login_..."])
    expires: datetime = Field(examples=["2026-11-23T09:15:00Z"])


def known_user(service: Service, name: str) -> User:
    """Return the user with a name; raise Refusal (404) if there is none."""
    user = service.users.get(name)
    if user is None:
        raise Refusal(404, f"no user {name!r:.80}")
    return user


def list_users(
    service: TheService,
    _: Admin,
    cursor: Annotated[str, Query(max_length=100, description="From the page before")] = "",
    limit: PageSize = 100,
) -> UserList:
    """List users by name."""
    users = [user for user in service.users.all() if user.name > cursor]
    following = users[limit - 1].name if len(users) > limit else None
    return UserList(users=[ListedUser.model_validate(user) for user in users[:limit]], next=following)


def add_user(request: Request, service: TheService, who: Admin, new: NewUser) -> ListedUser:
    """Add a user; like all that gives access, this needs a browser session."""
    _needs_session(who)
    request.state.detail = f"{new.name[:64]}, {new.role}"
    return ListedUser.model_validate(service.users.add(new.name, Role.of(new.role), new.password))


def change_user(request: Request, service: TheService, who: Admin, name: UserName, change: UserChange) -> ListedUser:
    """Change the role of a user, set their password, or disable them; fields that are left out stay unchanged.

    A token can only disable.
    """
    if not (change.disabled and change.role is None and change.password is None):
        _needs_session(who)
    known_user(service, name)
    given = change.model_dump(exclude_none=True)
    request.state.detail = ", ".join("password" if key == "password" else f"{key} {given[key]}" for key in given)
    role = None if change.role is None else Role.of(change.role)
    return ListedUser.model_validate(
        service.users.change(name, role=role, password=change.password, disabled=change.disabled)
    )


def end_access(service: TheService, _: Admin, name: UserName) -> None:
    """End all sessions, one-time links, tokens, shared links and webhooks of a user, who can log in again."""
    service.users.end_access(known_user(service, name).name)


def make_login_link(service: TheService, who: Admin, name: UserName) -> LoginLink:
    """Create a one-time login link for a user, valid for fifteen minutes; it is shown only this once.

    This needs a browser session.
    """
    _needs_session(who)
    if known_user(service, name).is_disabled:
        raise Refusal(409, f"{name} is disabled, so a link would lead nowhere; enable the account first")
    expires = datetime.fromtimestamp(datetime.now(UTC).timestamp() + LINK_LIVES, UTC)
    return LoginLink(link=login_address(service, name), expires=expires)


def login_address(service: Service, name: str) -> str:
    """Return a new one-time login link for a user."""
    return f"{service.settings.address}/login/link?key={service.sessions.new_link(name)}"


class ListedToken(_Listed):
    """A token, without its secret."""

    id: int = Field(examples=[1])
    user: str = Field(examples=["eva"])
    name: str = Field(examples=["nightly measurements"])
    role: RoleWord = Field(description="What it may do; never more than its user", examples=["engineer"])
    created: datetime = Field(examples=["2026-11-23T09:00:00Z"])
    expires: datetime = Field(examples=["2027-02-21T09:00:00Z"])
    used: datetime | None = Field(description="When it was last used, to the minute", examples=[None])
    revoked: datetime | None = Field(examples=[None])


class TokenList(BaseModel):
    """A page of the list of tokens, newest first."""

    tokens: list[ListedToken]
    next: int | None = Field(description="Cursor of the next page; null on the last one", examples=[None])


class NewToken(Sent):
    """A token to be created."""

    name: str = Field(min_length=1, max_length=100, examples=["nightly measurements"])
    role: RoleWord = Field(description="At most your own", examples=["engineer"])
    days: int = Field(90, ge=1, le=366, description="For how long it is valid", examples=[90])


class MadeToken(BaseModel):
    """A token that was just created."""

    token: ListedToken
    secret: str = Field(description="Shown this once: keep it", examples=["clearcap_token_..."])


def list_tokens(
    service: TheService,
    who: Viewer,
    everyone: Annotated[bool, Query(description="Also those of others; for admins")] = False,
    cursor: Cursor = None,
    limit: PageSize = 100,
) -> TokenList:
    """List your tokens, newest first; an admin may also list the tokens of others."""
    if everyone and not who.may(Role.ADMIN):
        raise lacks_role(who, Role.ADMIN, "to list the tokens of others")
    tokens = service.tokens.all(None if everyone else who.name)
    rest = [token for token in tokens if cursor is None or token.id < cursor]
    following = rest[limit - 1].id if len(rest) > limit else None
    return TokenList(tokens=[ListedToken.model_validate(token) for token in rest[:limit]], next=following)


def add_token(request: Request, service: TheService, who: Viewer, new: NewToken) -> MadeToken:
    """Create a token for yourself; this needs a browser session, so that a token cannot prolong its own life."""
    _needs_session(who)
    role = Role.of(new.role)
    if not who.may(role):
        raise Refusal(403, f"role = {new.role}: more than your own; allowed: up to {who.role.word}")
    valid = [token for token in service.tokens.all(who.name) if token.is_valid]
    if len(valid) >= MOST_TOKENS:
        raise Refusal(409, f"{who.name} has {len(valid)} tokens; allowed: {MOST_TOKENS}; revoke one")
    token, secret = service.tokens.add(who.name, new.name, role, new.days * DAY)
    request.state.detail = f"token {token.id}, {new.role}, {new.days} days"
    return MadeToken(token=ListedToken.model_validate(token), secret=secret)


def _needs_session(who: Principal) -> None:
    """Raise Refusal (403) unless the request has a session: a token acts for its user, but cannot change access."""
    if who.kind != "session":
        raise Refusal(403, "a token cannot do this; log in with a browser")


def revoke_token(service: TheService, who: Viewer, token: ListedId) -> None:
    """Revoke a token of yours, or, as an admin, of any user."""
    mine = service.tokens.all(None if who.may(Role.ADMIN) else who.name)
    if token not in {each.id for each in mine}:
        raise Refusal(404, f"no token {token} of {who.name}")
    service.tokens.revoke(token)


class PasswordChange(Sent):
    """A new password, and the one that it replaces."""

    present: str | None = Field(None, max_length=2000, description="Not needed if you have none yet")
    password: Password


def show_account(service: TheService, who: Viewer) -> ListedUser:
    """Show who you are."""
    return ListedUser.model_validate(known_user(service, who.name))


def set_password(request: Request, service: TheService, who: Viewer, change: PasswordChange) -> None:
    """Change your password; all your sessions end, including this one, but no tokens."""
    _needs_session(who)
    if known_user(service, who.name).has_password and checked_user(request, who.name, change.present or "") is None:
        raise Refusal(403, "present: is not your password")
    service.users.change(who.name, password=change.password, is_own=True)


def end_sessions(service: TheService, who: Viewer) -> None:
    """End all your sessions, on all machines."""
    service.sessions.end_all(who.name)


MOST_SHARES = 200  # valid links of a campaign


class ListedShare(_Listed):
    """A shared link, without its secret."""

    id: int = Field(examples=[1])
    campaign: str = Field(examples=["c60-0a1b2c3d4e"])
    by: str = Field(description="Who shared it", examples=["eva"])
    note: str = Field(description="For whom", examples=["the customer's review"])
    created: datetime = Field(examples=["2026-11-23T09:00:00Z"])
    expires: datetime = Field(examples=["2026-12-07T09:00:00Z"])
    revoked: datetime | None = Field(examples=[None])
    is_valid: bool = Field(description="It has neither expired nor been revoked", examples=[True])


class ShareList(BaseModel):
    """A page of the shared links of a campaign, newest first."""

    shares: list[ListedShare]
    next: int | None = Field(description="Cursor of the next page; null on the last one", examples=[None])


class NewShare(Sent):
    """A link to be created."""

    days: int = Field(14, ge=1, le=90, description="For how long it is valid", examples=[14])
    note: str = Field("", max_length=200, description="For whom", examples=["the customer's review"])


class MadeShare(BaseModel):
    """A link that was just created."""

    share: ListedShare
    link: str = Field(description="Shown this once", examples=["https://clearcap.example/shared/clearcap_share_..."])


def list_shares(
    service: TheService, campaign: TheCampaign, _: Engineer, cursor: Cursor = None, limit: PageSize = 100
) -> ShareList:
    """List the shared links to a campaign, newest first."""
    rest = [share for share in service.tokens.shares(campaign) if cursor is None or share.id < cursor]
    following = rest[limit - 1].id if len(rest) > limit else None
    return ShareList(shares=[ListedShare.model_validate(share) for share in rest[:limit]], next=following)


def add_share(request: Request, service: TheService, campaign: TheCampaign, who: Engineer, new: NewShare) -> MadeShare:
    """Create a link that lets anyone see this campaign, read-only."""
    if sum(share.is_valid for share in service.tokens.shares(campaign)) >= MOST_SHARES:
        raise Refusal(409, f"{campaign} has {MOST_SHARES} links; revoke one first")
    share, secret = service.tokens.share(campaign, who.name, new.note, new.days * DAY)
    request.state.detail = f"share {share.id}, {new.days} days"
    return MadeShare(share=ListedShare.model_validate(share), link=f"{service.settings.address}/shared/{secret}")


def revoke_share(service: TheService, campaign: TheCampaign, _: Engineer, share: ListedId) -> None:
    """Revoke a link, and end the sessions that were begun with it."""
    if not service.tokens.revoke_share(campaign, share):
        raise Refusal(404, f"no link {share} to {campaign}")


class ListedEntry(_Listed):
    """An entry of the audit trail."""

    number: int = Field(examples=[1])
    time: datetime = Field(examples=["2026-11-23T09:00:00Z"])
    who: str = Field(examples=["eva"])
    how: str = Field(description="session, token, share, password, link, company or none", examples=["session"])
    address: str = Field(examples=["127.0.0.1"])
    action: str = Field(examples=["POST /api/v1/tokens"])
    object: str = Field(examples=["c60-0a1b2c3d4e"])
    status: int = Field(description="Status of the answer: below 400 the request was carried out", examples=[201])
    detail: str = Field(examples=["token 1, engineer, 90 days"])
    digest: str = Field(description="SHA-256 of the digest before and all fields above", examples=["0f" * 32])


class EntryList(BaseModel):
    """A page of the audit trail, newest first."""

    entries: list[ListedEntry]
    next: int | None = Field(description="Cursor of the next page; null on the last one", examples=[None])


class Wholeness(BaseModel):
    """Whether the audit trail is intact."""

    whole: bool = Field(examples=[True])
    first_fault: int | None = Field(description="First entry that was changed, or is missing", examples=[None])


def list_audit(
    service: TheService,
    _: Admin,
    object: Annotated[str | None, Query(max_length=200, description="Of this campaign, user or token")] = None,
    who: Annotated[str | None, Query(max_length=100, description="Of this user")] = None,
    cursor: Cursor = None,
    limit: PageSize = 100,
) -> EntryList:
    """List who did what and when, newest first."""
    entries = service.audit.newest(cursor, object or None, who or None, limit + 1)
    following = entries[limit - 1].number if len(entries) > limit else None
    return EntryList(entries=[ListedEntry.model_validate(entry) for entry in entries[:limit]], next=following)


def check_audit(service: TheService, _: Admin) -> Wholeness:
    """Check that no entry of the audit trail was changed or removed."""
    fault = service.audit.first_fault()
    return Wholeness(whole=fault is None, first_fault=fault)


MOST_WEBHOOKS = 50  # of a user


class NewWebhook(Sent):
    """A webhook to be created."""

    url: str = Field(max_length=LONGEST_URL, description="https", examples=["https://quality.example/clearcap"])
    campaign: str | None = Field(None, pattern=CAMPAIGN_ID, description="By default all of yours", examples=[None])


class ListedWebhook(BaseModel):
    """A webhook, without its secret."""

    model_config = ConfigDict(from_attributes=True)
    id: int = Field(examples=[1])
    user: str = Field(examples=["eva"])
    url: str = Field(examples=["https://quality.example/clearcap"])
    campaign: str | None = Field(description="Null: all that the user owns or submitted", examples=[None])
    created: datetime = Field(examples=["2026-11-23T09:00:00Z"])


class MadeWebhook(BaseModel):
    """A webhook that was just created."""

    webhook: ListedWebhook
    secret: str = Field(description="Bodies are signed with it; shown this once", examples=["clearcap_webhook_..."])


class ListedDelivery(BaseModel):
    """The delivery of news to a webhook."""

    model_config = ConfigDict(from_attributes=True)
    event: str = Field(examples=["ended c60-0a1b2c3d4e completed 1795424400.000"])
    status: str = Field(description="waiting, delivered, given up, or why it was not accepted", examples=["delivered"])
    attempts: int = Field(examples=[1])
    next: datetime | None = Field(description="When it is sent again", examples=[None])


class ShownWebhook(BaseModel):
    """A webhook and its last deliveries."""

    webhook: ListedWebhook
    deliveries: list[ListedDelivery] = Field(description="The last ones, newest first")


def list_webhooks(service: TheService, who: Engineer) -> list[ListedWebhook]:
    """List your webhooks."""
    return [ListedWebhook.model_validate(webhook) for webhook in service.webhooks.all(who.name)]


def add_webhook(service: TheService, who: Engineer, new: NewWebhook) -> MadeWebhook:
    """Notify an address when a campaign ends, and when a Cpk's interval lies below 1.33.

    The address must be `https`; it may be in the server's own network only if the configuration names its host.
    """
    if len(service.webhooks.all(who.name)) >= MOST_WEBHOOKS:
        raise Refusal(409, f"{who.name} has {MOST_WEBHOOKS} webhooks; remove one")
    if new.campaign is not None and service.watcher.index.entry(new.campaign) is None:
        raise Refusal(422, f"campaign = {new.campaign}: no such campaign in the store")
    target_addresses(webhook_target(new.url, service.settings.webhook_hosts))
    webhook = service.webhooks.add(who.name, new.campaign, new.url, service.events())
    return MadeWebhook(webhook=ListedWebhook.model_validate(webhook), secret=webhook.secret)


def show_webhook(service: TheService, who: Engineer, webhook: ListedId) -> ShownWebhook:
    """Show a webhook of yours and its last deliveries."""
    found = _webhook(service, who.name if not who.may(Role.ADMIN) else None, webhook)
    sent = [ListedDelivery.model_validate(delivery) for delivery in service.webhooks.deliveries(found.id)]
    return ShownWebhook(webhook=ListedWebhook.model_validate(found), deliveries=sent)


def remove_webhook(service: TheService, who: Engineer, webhook: ListedId) -> None:
    """Remove a webhook of yours, or, as an admin, of any user; undelivered news is dropped."""
    service.webhooks.remove(_webhook(service, who.name if not who.may(Role.ADMIN) else None, webhook).id)


def _webhook(service: Service, user: str | None, webhook_id: int) -> Webhook:
    """Return a webhook of a user, or of any user; raise Refusal (404) if there is none."""
    for webhook in service.webhooks.all(user):
        if webhook.id == webhook_id:
            return webhook
    raise Refusal(404, f"no webhook {webhook_id} of yours")
