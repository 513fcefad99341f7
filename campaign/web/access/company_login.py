"""Log in by a company's login service: OpenID Connect, authorization code with PKCE, state and nonce."""

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
from campaign.web.access.principal import Role
from campaign.web.access.users import NAME, User, Users
from campaign.web.settings import Oidc

CALLBACK = "/login/company/callback"
LOGIN_WITHIN = 600  # s, for which a login that was begun can be ended
LEEWAY = 60  # s, by which the clocks may differ
TIMEOUT = 10.0  # s, for each answer of the login service
METADATA_LIVES = 3600.0  # s
ALGORITHMS = ("RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA", "Ed25519")
MOST_OF_A_NAME = 1000  # users whose names differ by a number only


class LoginFault(Exception):
    """A login by the company's service cannot go on; the message is for the user.

    Parameters
    ----------
    message : str
    is_outage : bool
        The service is at fault, and the same may work later.
    """

    def __init__(self, message: str, *, is_outage: bool = False) -> None:
        super().__init__(message)
        self.is_outage = is_outage


@dataclass(frozen=True)
class Identity:
    """Who somebody is to the login service.

    Attributes
    ----------
    subject : str
        Issuer and its name for him, which never changes.
    name : str
        What he is called.
    role : Role
        The highest of his groups; viewer if none is mapped.
    """

    subject: str
    name: str
    role: Role


class CompanyLogin:
    """Logins by a company's service.

    Parameters
    ----------
    oidc : Oidc
        The service, and what it knows this server by.
    address : str
        This server's address, without a path.
    transport
        How requests are sent; by default over the network.
    """

    def __init__(self, oidc: Oidc, address: str, transport: Any = None) -> None:
        self._oidc, self._transport = oidc, transport
        self._redirect = address + CALLBACK
        self._states = URLSafeTimedSerializer(secrets.token_bytes(32), salt="company login")
        self._tls = ssl.create_default_context()  # once: to read all authorities takes a quarter of a second
        self._metadata: tuple[float, dict[str, Any]] | None = None

    def begin(self, wanted: str) -> tuple[str, str]:
        """Begin a login.

        Parameters
        ----------
        wanted : str
            Path of this server to go to after it.

        Returns
        -------
        (str, str)
            Where the browser goes, and what its cookie keeps until it comes back.

        Raises
        ------
        LoginFault
            If the service does not answer as OpenID Connect says.
        """
        state, nonce, verifier = (secrets.token_urlsafe(32) for _ in range(3))
        endpoint = self._read_metadata()["authorization_endpoint"]
        with self._client() as client:
            url, _ = client.create_authorization_url(endpoint, state=state, nonce=nonce, code_verifier=verifier)
        kept = self._states.dumps({"state": state, "nonce": nonce, "verifier": verifier, "wanted": wanted})
        return str(url), kept if isinstance(kept, str) else kept.decode()

    def end(self, answer: Mapping[str, str], kept: str) -> tuple[Identity, str]:
        """End a login.

        Parameters
        ----------
        answer : mapping
            Parameters with which the service sent the browser back: ``code`` and ``state``, or ``error``.
        kept : str
            What the browser's cookie kept.

        Returns
        -------
        (Identity, str)
            Who he is, and the path that he wanted to go to.

        Raises
        ------
        LoginFault
            If this is not the answer to the login that this browser began, the service refuses, or its token does not
            prove who he is.
        """
        try:
            begun = self._states.loads(kept, max_age=LOGIN_WITHIN)
        except BadSignature as error:
            raise LoginFault("this login is too old, or began in another browser; log in again") from error
        if not hmac.compare_digest(begun["state"].encode(), answer.get("state", "").encode(errors="replace")):
            raise LoginFault("this is not the answer to the login that this browser began; log in again")
        if answer.get("iss", self._oidc.issuer) != self._oidc.issuer:
            raise LoginFault("this answer is from another login service; log in again")
        if "error" in answer or not answer.get("code"):
            word = answer.get("error", "no code")
            raise LoginFault(f"the login service refused: {word if re.fullmatch('[a-z_ ]{1,60}', word) else 'error'}")
        return self._identity(self._claims(answer["code"], begun["nonce"], begun["verifier"])), begun["wanted"]

    def _claims(self, code: str, nonce: str, verifier: str) -> Mapping[str, Any]:
        """Return the claims of the identity token for a code, after proving that they are the service's."""
        metadata = self._read_metadata()
        with self._client() as client:
            try:
                answer = client.fetch_token(metadata["token_endpoint"], code=code, code_verifier=verifier)
            except OAuthError as error:
                raise LoginFault("the login service does not accept its own answer; log in again") from error
            except Exception as error:  # the client has the errors of one of two libraries
                raise _outage(error) from error
        token = answer.get("id_token")
        if not isinstance(token, str):
            raise LoginFault("the login service sent no identity token; ask its admin for the scope openid")
        keys = self._fetch(metadata["jwks_uri"])
        try:
            decoded = jwt.decode(token, KeySet.import_key_set(keys), algorithms=list(ALGORITHMS))  # type: ignore[arg-type]  # checked by it
            claims = CodeIDToken(
                decoded.claims,
                decoded.header,
                {"iss": {"essential": True, "value": self._oidc.issuer}, "aud": _audience(self._oidc.client_id)},
                {"nonce": nonce, "client_id": self._oidc.client_id, "access_token": answer.get("access_token")},
            )
            claims.validate(leeway=LEEWAY)
        except (JoseError, ValueError, KeyError, TypeError) as error:
            kind = getattr(error, "error", type(error).__name__)
            raise LoginFault(f"the login service's identity token does not prove who you are ({kind})") from error
        return dict(claims)

    def _identity(self, claims: Mapping[str, Any]) -> Identity:
        """Return who the claims say somebody is."""
        subject = claims["sub"]
        if not isinstance(subject, str) or not 0 < len(subject) <= 255:
            raise LoginFault("the login service's identity token names no subject")
        groups = claims.get(self._oidc.roles_claim, [])
        held = {groups} if isinstance(groups, str) else {each for each in groups if isinstance(each, str)}
        roles = [Role.of(role) for group, role in self._oidc.roles.items() if group in held]
        name = next((claims[key] for key in ("preferred_username", "email", "name") if claims.get(key)), subject)
        return Identity(f"{self._oidc.issuer} {subject}", str(name), max([Role.VIEWER, *roles]))

    def _read_metadata(self) -> dict[str, Any]:
        """Return what the service says of itself, at most an hour ago."""
        if self._metadata is None or time.monotonic() - self._metadata[0] > METADATA_LIVES:
            document = self._fetch(f"{self._oidc.issuer.rstrip('/')}/.well-known/openid-configuration")
            if document.get("issuer") != self._oidc.issuer:
                raise LoginFault("the login service says that it is another issuer than oidc.issuer", is_outage=True)
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
            except Exception as error:  # the client has the errors of one of two libraries
                raise _outage(error) from error
        if not isinstance(document, dict):
            raise LoginFault("the login service does not speak OpenID Connect; check oidc.issuer", is_outage=True)
        return document

    def _client(self) -> Any:
        """Return a client of the service; it is closed by the block that uses it."""
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
    """Return the user of an identity: made at his first login; his role follows his groups.

    Raises
    ------
    LoginFault
        If he is disabled here.
    CampaignError
        If he is the last admin and his groups no longer say so.
    """
    user = users.by_subject(identity.subject)
    if user is None:
        try:
            return users.add(_free_name(users, identity.name), identity.role, subject=identity.subject)
        except CampaignError:
            user = users.by_subject(identity.subject)  # he logged in twice at the same moment
            if user is None:
                raise
    if user.is_disabled:
        raise LoginFault(f"the account {user.name} is disabled; ask an admin")
    return user if user.role is identity.role else users.change(user.name, role=identity.role)


def _free_name(users: Users, wanted: str) -> str:
    """Return a name like the one that is wanted, which no user has: nobody becomes another one by his name."""
    base = re.sub(r"[^A-Za-z0-9._@-]", "-", wanted).lstrip("._@-")[:58] or "user"
    names = [base, *(f"{base}-{number}" for number in range(2, MOST_OF_A_NAME))]
    return next(name for name in names if NAME.fullmatch(name) and users.get(name) is None)


def _audience(client_id: str) -> dict[str, Any]:
    return {"essential": True, "value": client_id}


def _outage(error: Exception) -> LoginFault:
    """Return the fault of a service that does not answer; its own words may quote secrets, so they are left out."""
    return LoginFault(f"the login service does not answer ({type(error).__name__}); try again later", is_outage=True)
