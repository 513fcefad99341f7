"""Login through a company's login service: OpenID Connect, authorization code with PKCE, state and nonce."""

import hmac
import re
import secrets
import ssl
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from authlib.integrations.httpx_client import OAuth2Client, OAuthError
from authlib.oidc.core import CodeIDToken
from itsdangerous import BadSignature, URLSafeTimedSerializer
from joserfc import jwt
from joserfc.errors import JoseError
from joserfc.jwk import KeySet

from campaign.errors import CampaignError
from clearcap.web.access.users import NAME, Role, User, Users
from clearcap.web.settings import Oidc

CALLBACK = "/login/company/callback"
LOGIN_WITHIN = 600  # s in which a login must be completed
LEEWAY = 60  # s by which the clocks may differ
TIMEOUT = 10.0  # s, for each answer of the login service
METADATA_LIVES = 3600.0  # s
# neither `none` nor shared secrets: only a key of the login service can sign
ALGORITHMS = ("RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA", "Ed25519")
MOST_OF_A_NAME = 1000  # users whose names differ only by a number


class LoginFault(Exception):
    """A login through the company's service failed; if that `is_outage`, the same login may work later."""

    def __init__(self, message: str, *, is_outage: bool = False) -> None:
        super().__init__(message)
        self.is_outage = is_outage


@dataclass(frozen=True)
class Identity:
    """A person's identity according to the login service."""

    subject: str  # issuer and its identifier of the person, which never changes
    name: str  # user name, e-mail address or name of the person
    role: Role  # highest role of the person's groups; viewer if no group has a role


class CompanyLogin:
    """Logins through a company's service; `address` is this server's, without a path."""

    def __init__(self, oidc: Oidc, address: str, transport: Any = None) -> None:
        self._oidc, self._transport = oidc, transport
        self._redirect = address + CALLBACK
        # a new key at each start: only logins that are in progress at that moment have to begin again
        self._states = URLSafeTimedSerializer(secrets.token_bytes(32), salt="company login")
        self._tls = ssl.create_default_context()  # once: reading all certificate authorities takes 0.25 s
        self._metadata: tuple[float, dict[str, Any]] | None = None

    def begin(self, wanted: str) -> tuple[str, str]:
        """Return where to send the browser, and a cookie that it keeps until it comes back for the path `wanted`."""
        state, nonce, verifier = (secrets.token_urlsafe(32) for _ in range(3))
        endpoint = self._read_metadata()["authorization_endpoint"]
        with self._client() as client:
            url, _ = client.create_authorization_url(endpoint, state=state, nonce=nonce, code_verifier=verifier)
        kept = self._states.dumps({"state": state, "nonce": nonce, "verifier": verifier, "wanted": wanted})
        return str(url), kept if isinstance(kept, str) else kept.decode()

    def end(self, answer: Mapping[str, str], kept: str) -> tuple[Identity, str]:
        """Return the identity that the browser's answer proves, with the cookie `kept`, and the path that it wanted."""
        try:
            begun = self._states.loads(kept, max_age=LOGIN_WITHIN)
        except BadSignature as error:
            raise LoginFault("this login is too old, or began in another browser; log in again") from error
        if not hmac.compare_digest(begun["state"].encode(), answer.get("state", "").encode(errors="replace")):
            raise LoginFault("this is not the answer to the login that this browser began; log in again")
        if answer.get("iss", self._oidc.issuer) != self._oidc.issuer:  # optional in an answer (RFC 9207)
            raise LoginFault("this answer comes from another login service; log in again")
        if "error" in answer or not answer.get("code"):
            word = answer.get("error", "no code")
            raise LoginFault(f"the login service refused: {word if re.fullmatch('[a-z_ ]{1,60}', word) else 'error'}")
        return self._identity(self._claims(answer["code"], begun["nonce"], begun["verifier"])), begun["wanted"]

    def _claims(self, code: str, nonce: str, verifier: str) -> Mapping[str, Any]:
        """Exchange a code for an identity token; verify the token and return its claims."""
        metadata = self._read_metadata()
        with self._client() as client:
            try:
                answer = client.fetch_token(metadata["token_endpoint"], code=code, code_verifier=verifier)
            except OAuthError as error:
                raise LoginFault("the login service does not accept its own answer; log in again") from error
            except Exception as error:  # the client raises errors of one of two libraries
                raise _outage(error) from error
        token = answer.get("id_token")
        if not isinstance(token, str):
            raise LoginFault("the login service sent no identity token; ask its admin for the scope openid")
        keys, wanted = self._fetch(metadata["jwks_uri"]), {"iss": self._oidc.issuer, "aud": self._oidc.client_id}
        try:
            decoded = jwt.decode(token, KeySet.import_key_set(keys), algorithms=list(ALGORITHMS))  # type: ignore[arg-type]  # checked by it
            claims = CodeIDToken(
                decoded.claims,
                decoded.header,
                {key: {"essential": True, "value": value} for key, value in wanted.items()},
                {"nonce": nonce, "client_id": self._oidc.client_id, "access_token": answer.get("access_token")},
            )
            claims.validate(leeway=LEEWAY)
        except (JoseError, ValueError, KeyError, TypeError) as error:
            kind = getattr(error, "error", type(error).__name__)
            raise LoginFault(f"the login service's identity token does not prove who you are ({kind})") from error
        return dict(claims)

    def _identity(self, claims: Mapping[str, Any]) -> Identity:
        """Return the identity that the claims of a token state."""
        subject = claims["sub"]
        if not isinstance(subject, str) or not 0 < len(subject) <= 255:
            raise LoginFault("the login service's identity token names no subject")
        groups = claims.get(self._oidc.roles_claim, [])
        held = {groups} if isinstance(groups, str) else {each for each in groups if isinstance(each, str)}
        roles = [Role.of(role) for group, role in self._oidc.roles.items() if group in held]
        name = next((claims[key] for key in ("preferred_username", "email", "name") if claims.get(key)), subject)
        return Identity(f"{self._oidc.issuer} {subject}", str(name), max([Role.VIEWER, *roles]))

    def _read_metadata(self) -> dict[str, Any]:
        """Return the service's metadata document; it is fetched again after an hour."""
        if self._metadata is None or time.monotonic() - self._metadata[0] > METADATA_LIVES:
            document = self._fetch(f"{self._oidc.issuer.rstrip('/')}/.well-known/openid-configuration")
            if document.get("issuer") != self._oidc.issuer:
                raise LoginFault("the login service states an issuer other than oidc.issuer", is_outage=True)
            for key in ("authorization_endpoint", "token_endpoint", "jwks_uri"):
                if not str(document.get(key)).startswith("https://"):
                    raise LoginFault(f"the login service names no {key} with https", is_outage=True)
            self._metadata = time.monotonic(), document
        return self._metadata[1]

    def _fetch(self, url: str) -> dict[str, Any]:
        """Return a JSON document of the service."""
        with self._client() as client:
            try:
                answer = client.request("GET", url, withhold_token=True)
                answer.raise_for_status()
                document = answer.json()
            except Exception as error:  # the client raises errors of one of two libraries
                raise _outage(error) from error
        if not isinstance(document, dict):
            raise LoginFault("the login service does not speak OpenID Connect; check oidc.issuer", is_outage=True)
        return document

    def _client(self) -> Any:
        """Return an HTTP client of the service; the block that uses it closes it."""
        return OAuth2Client(
            self._oidc.client_id,
            self._oidc.client_secret,
            scope="openid profile email",
            redirect_uri=self._redirect,
            code_challenge_method="S256",
            timeout=TIMEOUT,
            verify=self._tls,
            transport=self._transport,
        )


def company_user(users: Users, identity: Identity) -> User:
    """Return the user of an identity; create the user at the first login, and update their role from their groups."""
    user = users.by_subject(identity.subject)
    if user is None:
        try:
            return users.add(_free_name(users, identity.name), identity.role, subject=identity.subject)
        except CampaignError:
            user = users.by_subject(identity.subject)  # the same person logged in twice at the same moment
            if user is None:
                raise
    if user.is_disabled:
        raise LoginFault(f"the account {user.name} is disabled; ask an admin")
    return user if user.role is identity.role else users.change(user.name, role=identity.role)


def _free_name(users: Users, wanted: str) -> str:
    """Return an unused name similar to the wanted one, so that nobody takes over an account by choosing its name."""
    base = re.sub(r"[^A-Za-z0-9._@-]", "-", wanted).lstrip("._@-")[:58] or "user"  # leaves room for the number
    names = [base, *(f"{base}-{number}" for number in range(2, MOST_OF_A_NAME))]
    return next(name for name in names if NAME.fullmatch(name) and users.get(name) is None)


def _outage(error: Exception) -> LoginFault:
    """Return the fault for a service that does not answer, without the error's text, which may quote secrets."""
    return LoginFault(f"the login service does not answer ({type(error).__name__}); try again later", is_outage=True)
