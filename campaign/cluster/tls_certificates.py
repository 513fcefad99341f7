"""Certificates for the mutual TLS of one campaign cluster.

Dask checks only that the other side has a certificate of the same authority: it checks no host names and supports no
revocation. So each cluster gets an authority of its own, whose key is never written; to lock somebody out later, make a
new set of certificates.
"""

import datetime
import ipaddress
import os
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from distributed import Security

from campaign.errors import SpecError

ROLES = ("scheduler", "worker", "client")
LONGEST = 825  # days; the longest validity that common TLS libraries accept
_SKEW = datetime.timedelta(minutes=5)  # clocks of a cluster may differ


_Authority = tuple[x509.Certificate, ec.EllipticCurvePrivateKey]


def make_certificates(folder: Path, days: int, hosts: Sequence[str] = ()) -> dict[str, Path]:
    """Write the certificates of a new authority, and keys of mode 0600; return their paths; no file is replaced."""
    # ``hosts`` names the scheduler for tools that check names; dask does not.
    if not 1 <= days <= LONGEST:
        raise SpecError(f"--days {days}: must be 1 to {LONGEST}; make new certificates before these expire")
    now = datetime.datetime.now(datetime.UTC)
    contents = _contents((now - _SKEW, now + datetime.timedelta(days=days)), hosts)
    paths = {name: folder / name for name in contents}
    there = [str(path) for path in paths.values() if path.exists()]
    if there:
        raise SpecError(f"{', '.join(there)}: already exist and are never replaced; name another folder")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for name, content in contents.items():
            mode = 0o600 if name.endswith(".key") else 0o644  # from the start
            with os.fdopen(os.open(paths[name], os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
                file.write(content)
    except OSError as error:
        raise SpecError(f"{folder}: cannot be written ({error.strerror}); name a folder of yours") from error
    return paths


def passing_security() -> Security:
    """Return certificates of a new authority for one run on this machine; they exist only in memory."""
    # They are valid as far back as ahead, so that correcting the clock locks out no worker that replaces a dead one.
    now, validity = datetime.datetime.now(datetime.UTC), datetime.timedelta(days=LONGEST)
    contents = _contents((now - validity, now + validity), ())
    roles = {
        f"tls_{role}_{part}": contents[f"{role}.{end}"].decode()
        for role in ROLES
        for part, end in (("cert", "pem"), ("key", "key"))
    }
    ca = contents["ca.pem"].decode()
    return Security(tls_ca_file=ca, require_encryption=True, **roles)  # type: ignore[no-untyped-call]


def _contents(valid: tuple[datetime.datetime, datetime.datetime], hosts: Sequence[str]) -> dict[str, bytes]:
    """Return the certificates of a new authority and their keys, in PEM by file name."""
    authority = _authority(valid)
    contents = {"ca.pem": authority[0].public_bytes(serialization.Encoding.PEM)}
    for role in ROLES:
        pair = _signed(authority, role, hosts if role == "scheduler" else (), valid)
        contents[f"{role}.pem"], contents[f"{role}.key"] = pair
    return contents


def _authority(valid: tuple[datetime.datetime, datetime.datetime]) -> _Authority:
    """Return a new self-signed authority, which exists only in memory."""
    key = ec.generate_private_key(ec.SECP256R1())
    # programs that hold two authorities of the same name would confuse them
    name = _name(f"clearcap cluster {x509.random_serial_number():x}"[:40])
    builder = _begun(name, name, key.public_key(), key.public_key(), valid)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    builder = builder.add_extension(_usage(signs_certificates=True), critical=True)
    return builder.sign(key, hashes.SHA256()), key


def _signed(
    authority: _Authority, role: str, hosts: Sequence[str], valid: tuple[datetime.datetime, datetime.datetime]
) -> tuple[bytes, bytes]:
    """Return certificate and private key of a role, in PEM."""
    (authority_certificate, authority_key), key = authority, ec.generate_private_key(ec.SECP256R1())
    issuer, issuer_key = authority_certificate.subject, authority_key.public_key()
    builder = _begun(_name(f"clearcap {role}"), issuer, key.public_key(), issuer_key, valid)
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    builder = builder.add_extension(_usage(signs_certificates=False), critical=True)
    # scheduler and workers both listen and connect
    both = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    builder = builder.add_extension(both, critical=False)
    if hosts:
        builder = builder.add_extension(x509.SubjectAlternativeName([_host(h) for h in hosts]), critical=False)
    certificate = builder.sign(authority_key, hashes.SHA256())
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return certificate.public_bytes(serialization.Encoding.PEM), private


def _begun(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    issuer_key: ec.EllipticCurvePublicKey,
    valid: tuple[datetime.datetime, datetime.datetime],
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(valid[0])
        .not_valid_after(valid[1])
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key), critical=False)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    """Return a host as an IP address if it is one, else as a DNS name."""
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise SpecError(f"--host {host}: neither an address nor a host name in ASCII") from error
