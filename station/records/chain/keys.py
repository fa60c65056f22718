"""Keys: the one by which this computer signs, and those that it trusts (Ed25519).

    <own place>/keys/bench-key.pem    private, 0600, made at first use
    <own place>/keys/trusted.txt      public keys of other benches that a person has named
    <data folder>/bench-keys.txt      public keys that signed in this folder, for a computer that knows none of them

A public key is written `ed25519:` and 64 hexadecimal digits.
"""

from __future__ import annotations

import os
import re
import secrets
import socket
from functools import lru_cache
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)

from station.atomic_file import LARGEST_SMALL_FILE, document_bytes, open_file, open_handle, refused, sync_folder
from station.errors import RecordError, StationError
from station.own_place import own_folder, own_place

KEYS = "keys"
PRIVATE = "bench-key.pem"
TRUSTED = "trusted.txt"
FOLDER_KEYS = "bench-keys.txt"
"""Name of the file in the data folder."""

PREFIX = "ed25519:"
PUBLIC = re.compile(r"ed25519:[0-9a-f]{64}")
OTHERS = 0o077
"""Rights of group and others, of which a private key gives none."""


class BenchKey:
    """The private key by which this computer signs."""

    def __init__(self, private: Ed25519PrivateKey) -> None:
        self._private = private
        self.public = PREFIX + private.public_key().public_bytes_raw().hex()

    def sign(self, content: bytes) -> str:
        """Return the signature of some bytes, in hexadecimal digits."""
        signature = self._private.sign(content).hex()
        _kept(self.public, content, signature)[:] = [True]
        return signature


def own_key() -> BenchKey:
    """Return the key of this computer and user, made at first use.

    Raises:
        RecordError: it cannot be read or made, or others can read it.

    """
    path = own_folder(KEYS) / PRIVATE
    try:
        return _read(path)
    except FileNotFoundError:
        _make(path)
        return own_key()
    except OSError as error:
        raise refused(path, error, "read") from error


def own_public_key() -> str | None:
    """Return the public key of this computer and user; None where it has none, or it cannot be read."""
    try:
        return _read(own_place() / KEYS / PRIVATE).public
    except (OSError, StationError):
        return None


def _read(path: Path) -> BenchKey:
    with open_file(path) as file:
        rights = os.fstat(file.fileno()).st_mode
        if rights & OTHERS:
            raise RecordError(f"{path}: other users can read this private key. Run: chmod 600 {path}")
        content = document_bytes(file, LARGEST_SMALL_FILE)
    return _loaded(path, content)


@lru_cache(maxsize=8)
def _loaded(path: Path, content: bytes) -> BenchKey:
    try:
        private = load_pem_private_key(content, None)
    except (ValueError, TypeError) as error:
        raise RecordError(f"{path}: this file is not a private key: {error}. Restore it from a backup") from error
    if not isinstance(private, Ed25519PrivateKey):
        raise RecordError(f"{path}: this private key is not an Ed25519 key. Restore it from a backup")
    return BenchKey(private)


def _make(path: Path) -> None:
    """Make a key; of several processes that do so at once, one is first and its key counts for all."""
    content = Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    beside = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
        try:
            os.write(handle, content)
            os.fsync(handle)
        finally:
            os.close(handle)
        try:
            os.link(beside, path)
        except FileExistsError:
            pass
        finally:
            beside.unlink(missing_ok=True)
        sync_folder(path.parent)
    except OSError as error:
        raise refused(path, error) from error


@lru_cache(maxsize=64)
def _public(key: str) -> Ed25519PublicKey:
    return Ed25519PublicKey.from_public_bytes(bytes.fromhex(key.removeprefix(PREFIX)))


def signed_by(key: str, content: bytes, signature: str) -> bool:
    """Whether a signature is that of a public key over some bytes."""
    found = _kept(key, content, signature)
    if not found:
        found.append(_verified(key, content, signature))
    return found[0]


@lru_cache(maxsize=1024)
def _kept(_key: str, _content: bytes, _signature: str) -> list[bool]:
    """Return what was found of a signature, nothing as long as nobody has looked; it is kept for the newest.

    At every look the ends of the same chains and the same heads are asked for, and who signs reads it back soon.
    """
    return []


def _verified(key: str, content: bytes, signature: str) -> bool:
    try:
        _public(key).verify(bytes.fromhex(signature), content)
    except (InvalidSignature, ValueError, TypeError):
        return False
    return True


def check_public_key(text: str, where: str) -> str:
    """Return a public key that a person wrote; StationError where it is none."""
    if not PUBLIC.fullmatch(text.strip()):
        raise StationError(
            f"{where}: found {text[:40]!r}; allowed is a public key: 'ed25519:' and 64 hexadecimal digits. "
            "'lostmotion key' on the computer of the bench prints it"
        )
    return text.strip()


def keys_in(path: Path) -> list[str]:
    """Return the public keys in a file, one a line with remarks behind it; none where it cannot be read."""
    try:
        with open_file(path) as file:
            text = document_bytes(file, LARGEST_SMALL_FILE).decode("utf-8", "replace")
    except OSError:
        return []
    return list(dict.fromkeys(PUBLIC.findall(text)))


def trust(key: str) -> None:
    """Trust a public key from now on, in every data folder.

    Raises:
        RecordError: the file cannot be written.

    """
    _add(own_folder(KEYS) / TRUSTED, key, "trusted by a person")


def trusted_by_person() -> list[str]:
    """Return the public keys that a person has named on this computer."""
    return keys_in(own_place() / KEYS / TRUSTED)


def leave_in_folder(data: Path, key: str) -> None:
    """Write a public key into the data folder's file, once."""
    _add(data / FOLDER_KEYS, key, f"signed here first on {socket.gethostname()}")


def _add(path: Path, key: str, remark: str) -> None:
    if key in keys_in(path):
        return
    try:
        handle = open_handle(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o644)
        try:
            os.write(handle, f"{key}  {remark}\n".encode())
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        raise refused(path, error) from error
