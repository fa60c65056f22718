"""Certificates of the server and of the clients' applications: made, checked when the server starts, and trusted.

A client's application is trusted when its certificate lies in the folder of trusted certificates. One that was refused
is kept beside that folder, so that a person can look at it and trust it by one command.
"""

from __future__ import annotations

import ipaddress
import os
import socket
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from station.atomic_file import LARGEST_SMALL_FILE, document_bytes, open_file, write_atomic
from station.errors import StationError
from station.opcua.settings import FILE, OpcUaSettings
from station.wall_clock import WALL_CLOCK

DAYS = 5 * 365
KEY_BITS = 2048
REJECTED = "rejected"
MOST_REJECTED = 32
"""Refused certificates that are kept: a client makes a new one as often as it likes."""

LARGEST_BYTES = 64 * 1024
OUT_OF_DATE = "the certificate is valid"
"""How the problem of a certificate begins that is not valid today."""

NEXT = "Make a new certificate with: lostmotion opcua certificate --replace"


def make_certificate(data: Path, settings: OpcUaSettings, names: Sequence[str], *, replace: bool = False) -> Path:
    """Make key and certificate of the server, and return the file of the certificate.

    names: further host names and addresses by which clients reach it.

    Raises:
        StationError: there is one, and it is not to be replaced; a file cannot be written.

    """
    file, key_file = data / settings.certificate, data / settings.key
    there = [one for one in (file, key_file) if one.exists()]
    if there and not replace:
        raise StationError(
            f"{there[0]}: the server has a certificate already, and clients trust it. To replace it, add --replace"
        )
    key = rsa.generate_private_key(public_exponent=65537, key_size=KEY_BITS)
    content = made_certificate(key, application_uri(settings), [*hosts_of(settings), *names]).public_bytes(
        serialization.Encoding.DER
    )
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    for folder in {file.parent, key_file.parent, data / settings.trusted}:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    before = os.umask(0o077)
    try:
        write_atomic(key_file, private)
    finally:
        os.umask(before)
    write_atomic(file, content)
    return file


def made_certificate(
    key: rsa.RSAPrivateKey, uri: str, hosts: Sequence[str], days: int = DAYS, common_name: str = "lostmotion"
) -> x509.Certificate:
    """Return a certificate of an application, signed by itself, as OPC UA wants it (part 6, 6.2.2)."""
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])
    now = WALL_CLOCK.now()
    usage = x509.KeyUsage(
        digital_signature=True, content_commitment=True, key_encipherment=True, data_encipherment=True,
        key_agreement=False, key_cert_sign=True, crl_sign=False, encipher_only=False, decipher_only=False,
    )  # fmt: skip
    extended = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    told = [x509.UniformResourceIdentifier(uri), *(_host_name(host) for host in dict.fromkeys(hosts))]
    builder = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now - timedelta(days=max(1, 1 - days))).not_valid_after(
        now + timedelta(days=days)
    )
    builder = builder.add_extension(x509.SubjectAlternativeName(told), critical=False)
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    builder = builder.add_extension(usage, critical=True).add_extension(extended, critical=False)
    builder = builder.add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    return builder.sign(key, hashes.SHA256())


def _host_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def application_uri(settings: OpcUaSettings) -> str:
    """Return the URI by which clients know the server, as it stands in the certificate that is made for it."""
    return f"urn:{socket.gethostname()}:lostmotion:{'-'.join(settings.machine.serial_number.split())}"


def hosts_of(settings: OpcUaSettings) -> list[str]:
    """Return the names and addresses that a certificate of the server has to name."""
    own = [socket.gethostname()] if settings.every_address else [settings.host]
    return [*own, *(["localhost", "127.0.0.1"] if settings.host in ("localhost", "127.0.0.1", "::1") else [])]


def checked_certificate(data: Path, settings: OpcUaSettings) -> tuple[x509.Certificate, str]:
    """Return the certificate of the server and the URI in it.

    Raises:
        StationError: it is missing or damaged, is not valid today, is for another host, or its key is not its own.

    """
    file, key_file = data / settings.certificate, data / settings.key
    certificate = read_certificate(file, "Make it with: lostmotion opcua certificate")
    now = WALL_CLOCK.now()
    if certificate.not_valid_after_utc < now:
        raise StationError(f"{file}: this certificate expired on {certificate.not_valid_after_utc:%Y-%m-%d}. {NEXT}")
    if certificate.not_valid_before_utc > now:
        raise StationError(
            f"{file}: this certificate is valid only from {certificate.not_valid_before_utc:%Y-%m-%d} on. "
            "Check the computer's clock"
        )
    names = _alternative_names(certificate)
    uris = names.get_values_for_type(x509.UniformResourceIdentifier)
    if not uris:
        raise StationError(f"{file}: this certificate names no application URI. {NEXT}")
    known = [*names.get_values_for_type(x509.DNSName), *map(str, names.get_values_for_type(x509.IPAddress))]
    if not settings.every_address and settings.host.lower() not in {name.lower() for name in known}:
        raise StationError(
            f"{file}: this certificate is for {', '.join(known) or 'no host'}, not for {settings.host}, the host of "
            f"'endpoint' in {FILE}. {NEXT}"
        )
    _check_key(key_file, certificate)
    return certificate, str(uris[0])


def _check_key(file: Path, certificate: x509.Certificate) -> None:
    try:
        with open_file(file) as opened:
            key = serialization.load_pem_private_key(document_bytes(opened, LARGEST_SMALL_FILE), None)
        mode = file.stat().st_mode
    except OSError as error:
        raise StationError(f"{file}: this private key cannot be read: {error.strerror}. {NEXT}") from error
    except (ValueError, TypeError) as error:
        raise StationError(f"{file}: this is not a private key in PEM format without a password. {NEXT}") from error
    if mode & 0o077:
        raise StationError(f"{file}: other users can read this private key. Run: chmod 600 {file}")
    if key.public_key() != certificate.public_key():
        raise StationError(f"{file}: this private key does not belong to the certificate of the server. {NEXT}")


def _alternative_names(certificate: x509.Certificate) -> x509.SubjectAlternativeName:
    try:
        return certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return x509.SubjectAlternativeName([])


def read_certificate(file: Path, next_step: str = "Name a certificate in DER or PEM") -> x509.Certificate:
    """Return the certificate of a file, DER or PEM; StationError where there is none."""
    try:
        with file.open("rb") as opened:
            content = opened.read(LARGEST_BYTES)
        return (x509.load_pem_x509_certificate if b"-----BEGIN" in content else x509.load_der_x509_certificate)(content)
    except OSError as error:
        raise StationError(f"{file}: this certificate cannot be read: {error.strerror}. {next_step}") from error
    except ValueError as error:
        raise StationError(f"{file}: this file is not a certificate. {next_step}") from error


def fingerprint(certificate: x509.Certificate) -> str:
    """Return the SHA-256 of a certificate as hexadecimal."""
    return certificate.fingerprint(hashes.SHA256()).hex()


class Trust:
    """The folder of trusted certificates, read anew for each client that connects: what was removed counts no more."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._rejected = folder, folder.parent / REJECTED

    def problem_of(self, certificate: x509.Certificate) -> str:
        """Return why a client's certificate is refused, '' where it is not."""
        now = WALL_CLOCK.now()
        if not certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc:
            return (
                f"{OUT_OF_DATE} from {certificate.not_valid_before_utc:%Y-%m-%d} "
                f"to {certificate.not_valid_after_utc:%Y-%m-%d} only"
            )
        if fingerprint(certificate) in self._known():
            return ""
        return f"the certificate is not trusted. Trust it with: lostmotion opcua trust {self._keep(certificate)}"

    def _known(self) -> set[str]:
        known = set()
        for file in self._folder.glob("*"):
            try:
                known.add(fingerprint(read_certificate(file)))
            except StationError:
                continue  # whatever else lies there is nobody's certificate
        return known

    def _keep(self, certificate: x509.Certificate) -> Path:
        file = self._rejected / f"{fingerprint(certificate)[:40]}.der"
        if not file.exists():
            self._rejected.mkdir(mode=0o700, parents=True, exist_ok=True)
            oldest = sorted(self._rejected.glob("*.der"), key=lambda one: one.stat().st_mtime)
            for one in oldest[: max(0, len(oldest) - MOST_REJECTED + 1)]:
                one.unlink(missing_ok=True)
            write_atomic(file, certificate.public_bytes(serialization.Encoding.DER))
        return file

    def add(self, file: Path) -> tuple[Path, x509.Certificate]:
        """Trust the certificate of a file; return where it is kept, and itself. StationError where it is none."""
        certificate = read_certificate(file)
        kept = self._folder / f"{fingerprint(certificate)[:40]}.der"
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_atomic(kept, certificate.public_bytes(serialization.Encoding.DER))
        (self._rejected / kept.name).unlink(missing_ok=True)
        return kept, certificate
