"""Sending of news to webhooks, which is repeated until the receiver accepts it."""

import asyncio
import hashlib
import hmac
import logging
import time
from collections.abc import Callable, Iterable

import httpx

from campaign.errors import SpecError
from clearcap.web.webhooks.webhook_repository import CampaignEvent, Delivery, Webhook, WebhookRepository
from clearcap.web.webhooks.webhook_target import target_addresses, webhook_target

LOOK_EVERY = 2.0  # s
AT_ONCE = 8  # deliveries
ANSWER_WITHIN = 10.0  # s

logger = logging.getLogger(__name__)
# httpx logs each URL at the level INFO, and that of a webhook may hold a secret
logging.getLogger("httpx").setLevel(logging.WARNING)


class WebhookSender:
    """Send news about campaigns to webhooks, in the server's own network only to the hosts `allowed`.

    `news` returns what follows from the states of all campaigns, `clock` the time in seconds since 1970.
    """

    def __init__(
        self,
        book: WebhookRepository,
        news: Callable[[], Iterable[CampaignEvent]],
        allowed: Iterable[str],
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._book, self._news, self._clock = book, news, clock
        self._allowed = tuple(allowed)
        self._webhooks, self._told = set[int](), set[str]()  # webhooks, and keys of the news, that the book has

    async def run(self) -> None:
        """Send news as it comes, until cancelled."""
        while True:
            try:
                await asyncio.to_thread(self.tell)
                due = await asyncio.to_thread(self._book.due, AT_ONCE)
                await asyncio.gather(*(self._attempt(*each) for each in due))
            except Exception:
                logger.exception("news could not be sent to webhooks")
                due = []
            if len(due) < AT_ONCE:
                await asyncio.sleep(LOOK_EVERY)

    def tell(self) -> None:
        """Enter the news since the last call into the book."""
        webhooks = {webhook.id for webhook in self._book.all()}
        if webhooks != self._webhooks:
            self._webhooks, self._told = webhooks, set()  # a new webhook may not have been told yet
        if not webhooks:
            return
        news = list(self._news())
        self._book.tell(each for each in news if each.key not in self._told)
        self._told = {each.key for each in news}

    async def _attempt(self, webhook: Webhook, delivery: Delivery) -> None:
        """Send news once, and record whether it was accepted."""
        fault = await self.send(webhook, delivery)
        await asyncio.to_thread(self._book.record, delivery, fault)

    async def send(self, webhook: Webhook, delivery: Delivery) -> str | None:
        """Send news once; return why it was not accepted, or None if it was.

        The connection goes to the checked address, even if the host name resolves to another one meanwhile. Redirects
        are not followed, and no proxy is used.
        """
        try:
            target = webhook_target(webhook.url, self._allowed)
            address = (await asyncio.to_thread(target_addresses, target))[0]
            shown = f"[{address}]" if ":" in address else address
            body = delivery.body.encode()
            headers = {
                "Host": target.authority,
                "Content-Type": "application/json",
                "User-Agent": "clearcap",
                "X-Clearcap-Signature": signature(webhook.secret, body, int(self._clock())),
            }
            async with (
                asyncio.timeout(ANSWER_WITHIN),
                httpx.AsyncClient(trust_env=False, follow_redirects=False, timeout=ANSWER_WITHIN) as client,
                client.stream(
                    "POST",
                    f"{target.scheme}://{shown}:{target.port}{target.rest}",
                    content=body,
                    headers=headers,
                    extensions={"sni_hostname": target.host},  # the URL has the address; the certificate, the name
                ) as response,
            ):
                return None if response.is_success else f"answered with status {response.status_code}"
        except SpecError as error:
            return str(error)
        except TimeoutError:
            return f"no answer within {ANSWER_WITHIN:g} s"
        except (httpx.HTTPError, OSError, ValueError) as error:
            return f"cannot be reached ({type(error).__name__})"


def signature(secret: str, body: bytes, at: int) -> str:
    """Return the signature of a body: ``t=SECONDS,v1=HEX``.

    SECONDS is `at`; HEX is the HMAC-SHA256 of ``SECONDS.BODY`` with the secret as key. Receivers refuse old signatures,
    so that nobody can replay a body.
    """
    digest = hmac.new(secret.encode(), f"{at}.".encode() + body, hashlib.sha256).hexdigest()
    return f"t={at},v1={digest}"
