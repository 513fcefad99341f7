"""Webhooks, which notify other systems when a campaign ends or a Cpk is too small."""

from datetime import datetime

from pydantic import BaseModel, ConfigDict, Field

from clearcap.web.access import Role
from clearcap.web.http.authentication import CAMPAIGN_ID, Engineer, TheService
from clearcap.web.http.problems import Refusal
from clearcap.web.operations.people import ListedId
from clearcap.web.web_service import Service
from clearcap.web.webhooks import LONGEST_URL, Webhook, target_addresses, webhook_target

MOST_WEBHOOKS = 50  # of a user


class NewWebhook(BaseModel):
    """A webhook to be created."""

    model_config = ConfigDict(extra="forbid")
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
