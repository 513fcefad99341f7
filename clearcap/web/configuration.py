"""The configuration file of a server: its limits, and the company's login service."""

import os
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from campaign.errors import SpecError
from clearcap.web.access import Role
from clearcap.web.settings import Limits, Oidc
from engine.platform.toml_file import UnfitToml, read_toml

SECRET = "CLEARCAP_OIDC_SECRET"  # environment variable of the login service's client secret


class _OidcTable(BaseModel):
    """The table ``[oidc]``."""

    model_config = ConfigDict(extra="forbid", strict=True)
    issuer: Annotated[str, Field(pattern=r"^https://[^\s]+$")]
    client_id: str
    roles_claim: str = "groups"
    roles: dict[str, str] = {}


class _WebhookTable(BaseModel):
    """The table ``[webhooks]``."""

    model_config = ConfigDict(extra="forbid", strict=True)
    allow: list[Annotated[str, Field(pattern=r"^[A-Za-z0-9._:-]{1,253}$")]] = []


class _Tables(BaseModel):
    """The tables of the file."""

    model_config = ConfigDict(extra="forbid", strict=True)
    limits: dict[str, Annotated[float, Field(gt=0)]] = {}
    oidc: _OidcTable | None = None
    webhooks: _WebhookTable = _WebhookTable()


def read_configuration(path: Path | None) -> tuple[Limits, Oidc | None, tuple[str, ...]]:
    """Return the limits, login service and hosts for webhooks in the server's own network; None selects the defaults.

    The TOML file has the tables ``[limits]``, ``[oidc]`` and ``[webhooks]``. The secret of the login service is not
    part of it: it is read from the environment variable ``CLEARCAP_OIDC_SECRET``. Raises SpecError if the file cannot
    be read or is invalid, or the secret is missing.
    """
    if path is None:
        return Limits(), None, ()
    try:
        tables = TypeAdapter(_Tables).validate_python(read_toml(path))
    except (OSError, UnfitToml) as error:
        raise SpecError(f"--config {path}: cannot be read ({error})") from error
    except ValidationError as error:
        lines = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors()]
        raise SpecError("\n  ".join([f"--config {path}:", *lines])) from error
    return _limits(path, tables.limits), _oidc(path, tables.oidc), tuple(tables.webhooks.allow)


def _limits(path: Path, table: dict[str, float]) -> Limits:
    """Return the limits: the values of the file, and defaults for the rest."""
    kinds: dict[str, Any] = {f.name: type(f.default) for f in fields(Limits)}
    if unknown := sorted(table.keys() - kinds.keys()):
        raise SpecError(f"--config {path}: limits.{unknown[0]}: no such limit; limits: {', '.join(kinds)}")
    return Limits(**{name: kinds[name](value) for name, value in table.items()})


def _oidc(path: Path, table: _OidcTable | None) -> Oidc | None:
    """Return the login service."""
    if table is None:
        return None
    secret = os.environ.get(SECRET)
    if not secret:
        raise SpecError(f"--config {path}: oidc: the environment variable {SECRET} is missing; set the client's secret")
    for group, role in table.roles.items():
        try:
            Role.of(role)
        except ValueError as error:
            raise SpecError(f"--config {path}: oidc.roles.{group}: {error}") from error
    return Oidc(table.issuer, table.client_id, secret, table.roles_claim, table.roles)
