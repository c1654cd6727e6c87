"""Makes the certificates of one robot's bus, by a small private authority."""

from __future__ import annotations

import ipaddress
import re
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from surefoot.robot_io.errors import CertificateError
from surefoot.robot_io.security.own_certificates import names_of, read_certificates
from surefoot.schemas.toml_file import atomic_file

LISTENERS = ("robot", "router")
IDENTITIES = (*LISTENERS, "stabilizer", "operator", "planner", "observer")
_HOST_NAME = re.compile(r"([\w-]+\.)*[\w-]*[a-z_-][\w-]*\.?", re.ASCII | re.IGNORECASE)
"""Host name; its last part is no number, since 192.0.2 would be a cut-off address."""
LONGEST_PART, LONGEST_NAME = 63, 253
"""Lengths that a host name, and each part of it between dots, may have [bytes]."""
LOOPBACK = ("localhost", "127.0.0.1", "::1")
AUTHORITY = "ca"
AUTHORITY_DAYS = 3650
CLOCK_SKEW = timedelta(minutes=5)
_PRIVATE, _PUBLIC = 0o600, 0o644


@dataclass(frozen=True)
class Issued:
    """A certificate and its private key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def make_certificates(
    folder: Path, *, hosts: list[str], days: int, now: datetime | None = None
) -> list[Path]:
    """Make an authority and one certificate per identity.

    Args:
        folder: created if missing; receives ``NAME.pem`` and ``NAME.key.pem``.
        hosts: names and addresses under which robot or router are dialed, besides
            loopback.
        days: validity of the certificates; the authority is valid for ten years.
        now: start of the validity; the present when None.

    Returns:
        The files written.

    Raises:
        CertificateError: some of the files exist already, or the folder holds others.
        OSError: the files cannot be written; then none is.
    """
    there = [path for path in _files(folder, (AUTHORITY, *IDENTITIES)) if path.exists()]
    if there:
        raise CertificateError(
            f"{there[0]} is there already, and {len(there) - 1} more; --renew makes "
            "new certificates by the same authority, or choose another folder"
        )
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        got = "is no folder" if folder.is_file() else "holds other files"
        raise CertificateError(
            f"--out {folder}: {got}; private keys go into an empty or new folder; name "
            "one"
        )
    for host in hosts:  # before anything is written
        _place(host)
    now = now or datetime.now(UTC)
    authority = _make_authority(now)
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    pairs = _issue_all(authority, hosts=hosts, days=days, now=now)
    try:
        return _write(folder, {AUTHORITY: authority, **pairs})
    except OSError:
        if is_new:
            folder.rmdir()
        raise


def renew_certificates(
    folder: Path, *, hosts: list[str], days: int, now: datetime | None = None
) -> list[Path]:
    """Make new certificates and keys by the existing authority.

    Args:
        folder: folder that :func:`make_certificates` wrote.
        hosts: names and addresses besides those in the old certificates.
        days: validity of the new certificates.
        now: start of the validity; the present when None.

    Returns:
        The files replaced.

    Raises:
        CertificateError: the authority is missing, unreadable, or expires before them;
            or an old certificate cannot be read.
        OSError: the files cannot be written; then all are as before.
    """
    now = now or datetime.now(UTC)
    authority = _read(folder, AUTHORITY)
    hosts = [*_hosts_so_far(folder), *hosts]
    if authority.certificate.not_valid_after_utc < now + timedelta(days=days):
        over = authority.certificate.not_valid_after_utc.date()
        raise CertificateError(
            f"{folder}: the authority itself is valid until {over} only; make a new "
            "one in another folder, and give its certificates to every process"
        )
    return _write(folder, _issue_all(authority, hosts=hosts, days=days, now=now))


def _make_authority(now: datetime) -> Issued:
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name("Surefoot private authority")
    identifier = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
    certificate = (
        _builder(name, name, key, now=now, days=AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs=True), critical=True)
        .add_extension(identifier, critical=False)
        .sign(key, hashes.SHA256())
    )
    return Issued(certificate, key)


def issue(
    name: str, authority: Issued, *, hosts: list[str], days: float, now: datetime
) -> Issued:
    """Make a certificate for one identity."""
    key = ec.generate_private_key(ec.SECP256R1())
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    places = [name]
    if name in LISTENERS:
        uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        places += [*LOOPBACK, *hosts]
    issuer = authority.certificate
    signer = x509.AuthorityKeyIdentifier.from_issuer_public_key(
        authority.key.public_key()
    )
    certificate = (
        _builder(_name(name), issuer.subject, key, now=now, days=days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(
            x509.SubjectAlternativeName([_place(p) for p in dict.fromkeys(places)]),
            critical=False,
        )
        .add_extension(signer, critical=False)
        .sign(authority.key, hashes.SHA256())
    )
    return Issued(certificate, key)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    *,
    now: datetime,
    days: float,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SKEW)
        .not_valid_after(now + timedelta(days=days))
    )


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        key_cert_sign=signs,
        crl_sign=signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _place(host: str) -> x509.GeneralName:
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        pass
    else:
        if "%" in host:
            raise CertificateError(
                f"host {host!r}: a certificate cannot hold an address with a zone; "
                "expected a name, or an address without %"
            )
        return x509.IPAddress(address)
    name = host.removesuffix(".")
    if (
        not _HOST_NAME.fullmatch(name)
        or len(name) > LONGEST_NAME
        or max(map(len, name.split("."))) > LONGEST_PART
    ):
        raise CertificateError(
            f"host {host!r} is neither an address nor a name in ASCII, without "
            "protocol and port; expected one such as 192.0.2.10 or robot.local"
        )
    return x509.DNSName(name)


def _hosts_so_far(folder: Path) -> list[str]:
    """Return names and addresses in the listeners' present certificates."""
    paths = [folder / f"{name}.pem" for name in LISTENERS]
    found = [names_of(read_certificates(path)[0]) for path in paths if path.exists()]
    return [host for hosts in found for host in hosts if host not in LISTENERS]


def _issue_all(
    authority: Issued, *, hosts: list[str], days: int, now: datetime
) -> dict[str, Issued]:
    return {
        name: issue(name, authority, hosts=hosts, days=days, now=now)
        for name in IDENTITIES
    }


def _files(folder: Path, names: tuple[str, ...]) -> list[Path]:
    return [
        folder / f"{name}{suffix}" for name in names for suffix in (".pem", ".key.pem")
    ]


def _read(folder: Path, name: str) -> Issued:
    certificate_file, key_file = _files(folder, (name,))
    try:
        key = serialization.load_pem_private_key(key_file.read_bytes(), password=None)
        certificate = x509.load_pem_x509_certificate(certificate_file.read_bytes())
    except FileNotFoundError as error:
        raise CertificateError(
            f"{folder}: no authority to renew with: {error.filename} is not there; put "
            "it back, or make a new authority in another folder without --renew"
        ) from error
    except (OSError, ValueError, TypeError) as error:  # TypeError: it has a password
        raise CertificateError(
            f"{folder}: the authority cannot be read ({error}); expected "
            f"{certificate_file.name} and {key_file.name} as surefoot certs made them"
        ) from error
    if (
        not isinstance(key, ec.EllipticCurvePrivateKey)
        or key.public_key() != certificate.public_key()
    ):
        raise CertificateError(
            f"{key_file}: not the key of {certificate_file}; put the two files back "
            "that surefoot certs made together"
        )
    return Issued(certificate, key)


def _write(folder: Path, pairs: dict[str, Issued]) -> list[Path]:
    """Write all pairs or none: a new key does not fit an old certificate.

    Others can never read a key, not even while it is written.
    """
    paths = _files(folder, tuple(pairs))
    contents = [part for pair in pairs.values() for part in _contents(pair)]
    with ExitStack() as files:
        for path, (data, mode) in zip(paths, contents, strict=True):
            file = files.enter_context(atomic_file(path, mode=mode))
            file.write(data)
            file.flush()  # a full disk shows before any file has its final name
    return paths


def _contents(pair: Issued) -> list[tuple[bytes, int]]:
    """Return certificate and key as bytes, each with the mode of its file."""
    key = pair.key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    certificate = pair.certificate.public_bytes(serialization.Encoding.PEM)
    return [(certificate, _PUBLIC), (key, _PRIVATE)]
