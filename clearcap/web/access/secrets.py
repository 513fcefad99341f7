"""Random secrets of sessions, tokens and links, and hashes of passwords; only digests are kept."""

import hashlib
import hmac
import secrets

WORD_BYTES = 32
_COST, _BLOCK, _PARALLEL = 2**15, 8, 1  # of scrypt: 32 MiB and about 0.1 s per password


def new_secret(kind: str) -> str:
    """Return a new secret; `kind` is part of its prefix, by which scanners find secrets in repositories."""
    return f"clearcap_{kind}_{secrets.token_urlsafe(WORD_BYTES)}"


def digest(secret: str) -> bytes:
    """Return the digest that is kept of a secret; SHA-256 suffices, because the secret has 256 random bits."""
    return hashlib.sha256(secret.encode(errors="surrogatepass")).digest()


def hash_password(password: str) -> str:
    """Return the hash that is kept of a password: scrypt with a random salt."""
    salt = secrets.token_bytes(16)
    return f"scrypt${salt.hex()}${_scrypt(password, salt).hex()}"


def is_password(password: str, kept: str | None) -> bool:
    """Return whether a password matches a kept hash; without a hash the answer takes as long, so that nothing shows."""
    _, salt, expected = (kept or f"scrypt${bytes(16).hex()}${bytes(32).hex()}").split("$")
    is_equal = hmac.compare_digest(_scrypt(password, bytes.fromhex(salt)), bytes.fromhex(expected))
    return is_equal and kept is not None


def _scrypt(password: str, salt: bytes) -> bytes:
    text = password.encode(errors="surrogatepass")
    return hashlib.scrypt(text, salt=salt, n=_COST, r=_BLOCK, p=_PARALLEL, maxmem=64 * 1024**2, dklen=32)
