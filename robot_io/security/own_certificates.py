"""Looks at a process's own certificates before it opens the bus with them.

Zenoh opens a session with an expired certificate, or with a key that belongs to
another one, and says nothing: the others turn the process away, and are asked about
theirs. What is wrong on our own side is known here, at the start.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.serialization import PublicFormat
from cryptography.x509.oid import ExtendedKeyUsageOID

from surefoot.robot_io.errors import CertificateError
from surefoot.schemas.endpoints import Endpoints, Tls

_RENEW = "make new ones with surefoot certs --renew"
_DATE = "%Y-%m-%d %H:%M UTC"
_USES = {
    True: (ExtendedKeyUsageOID.SERVER_AUTH, "listen", "robot or router"),
    False: (ExtendedKeyUsageOID.CLIENT_AUTH, "dial", "whoever dials"),
}


def check_own_certificates(
    endpoints: Endpoints, *, is_listening: bool, now: datetime | None = None
) -> None:
    """Refuse certificates of ours that the others would turn away.

    Args:
        endpoints: with paths of certificates, or without TLS.
        is_listening: whether this process listens, or else dials.
        now: the present when None.

    Raises:
        CertificateError: names the file, what is wrong with it, and what to do.
    """
    tls = endpoints.tls
    if tls is None:
        return
    now = now or datetime.now(UTC)
    chain = read_certificates(Path(tls.certificate))
    authorities = read_certificates(Path(tls.ca))
    for path, certificates in ((tls.certificate, chain), (tls.ca, authorities)):
        for certificate in certificates:
            _check_dates(Path(path), certificate, now)
    _check_key(tls, chain[0])
    _check_signature(tls, chain, authorities)
    _check_use(tls, chain[0], is_listening=is_listening)


def read_certificates(path: Path) -> list[x509.Certificate]:
    """Certificates of a PEM file, at least one.

    Raises:
        CertificateError: it cannot be read, or holds none.
    """
    try:
        return x509.load_pem_x509_certificates(path.read_bytes())
    except OSError as error:
        raise CertificateError(
            f"{path}: the certificate cannot be read ({error.strerror or error})"
        ) from error
    except ValueError as error:
        raise CertificateError(
            f"{path}: holds no certificate (PEM, BEGIN CERTIFICATE); name the .pem "
            "that surefoot certs made"
        ) from error


def names_of(certificate: x509.Certificate) -> list[str]:
    """Names and addresses under which its owner may be dialed."""
    try:
        found = certificate.extensions.get_extension_for_class(
            x509.SubjectAlternativeName
        ).value
    except (x509.ExtensionNotFound, ValueError):
        return []
    return [
        *found.get_values_for_type(x509.DNSName),
        *map(str, found.get_values_for_type(x509.IPAddress)),
    ]


def _check_dates(path: Path, certificate: x509.Certificate, now: datetime) -> None:
    until, since = certificate.not_valid_after_utc, certificate.not_valid_before_utc
    if now > until:
        raise CertificateError(
            f"{path}: our certificate expired on {until.strftime(_DATE)}; {_RENEW}"
        )
    if now < since:
        raise CertificateError(
            f"{path}: our certificate is valid from {since.strftime(_DATE)} on, and "
            f"it is {now.strftime(_DATE)} here; set the clock, or {_RENEW}"
        )


def _check_key(tls: Tls, certificate: x509.Certificate) -> None:
    path = Path(tls.key)
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except OSError as error:
        raise CertificateError(
            f"{path}: our private key cannot be read ({error.strerror or error}); it "
            "must belong to the user who runs this"
        ) from error
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise CertificateError(
            f"{path}: no private key that can be used (PEM, without a password); name "
            "the .key.pem that surefoot certs made"
        ) from error
    form = serialization.Encoding.DER, PublicFormat.SubjectPublicKeyInfo
    ours = key.public_key().public_bytes(*form)
    if ours != certificate.public_key().public_bytes(*form):
        raise CertificateError(
            f"{path}: this key does not belong to {tls.certificate}; name the two "
            "files of one identity"
        )


def _check_signature(
    tls: Tls, chain: list[x509.Certificate], authorities: list[x509.Certificate]
) -> None:
    if any(_is_signed_by(link, one) for link in chain for one in authorities):
        return
    raise CertificateError(
        f"{tls.certificate}: not signed by the authority in {tls.ca} (it names "
        f"{chain[0].issuer.rfc4514_string()!r}); take both from one folder of surefoot "
        "certs"
    )


def _is_signed_by(certificate: x509.Certificate, authority: x509.Certificate) -> bool:
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        return False
    return True


def _check_use(tls: Tls, certificate: x509.Certificate, *, is_listening: bool) -> None:
    try:
        uses = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage)
    except (x509.ExtensionNotFound, ValueError):
        return  # good for everything
    wanted, verb, who = _USES[is_listening]
    if wanted not in uses.value:
        raise CertificateError(
            f"{tls.certificate}: not a certificate to {verb} with; take that of {who}"
        )
