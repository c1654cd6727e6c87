"""Checks certificates before they are used: our own, and the other side's.

Zenoh opens a session without a word even if a certificate has expired or a key belongs
to another certificate. The peers then refuse this process, and users look for the fault
there. These checks find faults of our own side at the start.
"""

from __future__ import annotations

import ipaddress
import socket
import ssl
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.serialization import PublicFormat
from cryptography.x509.oid import ExtendedKeyUsageOID

from surefoot.robot_io.errors import CertificateError
from surefoot.robot_io.security.locators import place_of, protocol_of
from surefoot.schemas.endpoints import Endpoints, Tls

LOOK_S = 1.0
"""Longest look at a peer's certificate, only after the bus has failed [s]. It is longer
than a handshake."""
_RENEW = "make new ones with surefoot certs --renew"
_DATE = "%Y-%m-%d %H:%M UTC"


def peer_fault(endpoints: Endpoints, locators: list[str]) -> str:
    """Return what is wrong with the certificates at some locators, in words.

    Returns:
        Empty if nothing is wrong, nobody answers, or the check is not possible.
    """
    if endpoints.tls is None:
        return ""
    try:
        authorities = read_certificates(Path(endpoints.tls.ca))
    except CertificateError:
        return ""
    faults = (
        _fault(endpoints, locator, authorities)
        for locator in locators
        if protocol_of(locator) == "tls"
    )
    return "; ".join(filter(None, faults))


def _fault(
    endpoints: Endpoints, locator: str, authorities: list[x509.Certificate]
) -> str:
    host, port = place_of(locator)
    certificate = _shown_at(endpoints, host, port)
    if certificate is None:
        return ""
    if not any(_is_signed_by(certificate, one) for one in authorities):
        return f"the certificate at {locator} is of another authority than ours"
    until = certificate.not_valid_after_utc
    if datetime.now(UTC) > until:
        return f"the certificate at {locator} expired on {until:%Y-%m-%d %H:%M} UTC"
    names = names_of(certificate)
    if not _is_among(host, names):
        return (
            f"the certificate at {locator} is for {', '.join(names) or 'no host'}, not "
            f"for {host}; dial one of these, or make it anew with surefoot certs "
            f"--renew --host {host}"
        )
    return ""


def _is_among(host: str, names: list[str]) -> bool:
    try:
        return str(ipaddress.ip_address(host)) in names
    except ValueError:
        return host.lower() in (name.lower() for name in names)


def _shown_at(endpoints: Endpoints, host: str, port: int) -> x509.Certificate | None:
    """Return the certificate that a peer shows; the peer itself is not trusted."""
    tls = endpoints.tls
    if tls is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    try:
        context.load_cert_chain(tls.certificate, tls.key)
        with (
            socket.create_connection((host, port), timeout=LOOK_S) as plain,
            context.wrap_socket(plain) as secured,
        ):
            shown = secured.getpeercert(binary_form=True)
        return None if shown is None else x509.load_der_x509_certificate(shown)
    except (OSError, ValueError):  # ssl's errors are among them
        return None


_USES = {
    True: (ExtendedKeyUsageOID.SERVER_AUTH, "listen", "robot or router"),
    False: (ExtendedKeyUsageOID.CLIENT_AUTH, "dial", "whoever dials"),
}


def check_own_certificates(endpoints: Endpoints, *, is_listening: bool) -> None:
    """Refuse certificates of ours that the peers would refuse.

    Args:
        endpoints: with paths of certificates, or without TLS.
        is_listening: whether this process listens; otherwise it dials.

    Raises:
        CertificateError: names the file, its fault, and what to do.
    """
    tls = endpoints.tls
    if tls is None:
        return
    now = datetime.now(UTC)
    chain = read_certificates(Path(tls.certificate))
    authorities = read_certificates(Path(tls.ca))
    for path, certificates in ((tls.certificate, chain), (tls.ca, authorities)):
        for certificate in certificates:
            _check_dates(Path(path), certificate, now)
    _check_key(tls, chain[0])
    _check_signature(tls, chain, authorities)
    _check_use(tls, chain[0], is_listening=is_listening)


def read_certificates(path: Path) -> list[x509.Certificate]:
    """Return the certificates of a PEM file, at least one.

    Raises:
        CertificateError: the file cannot be read, or holds none.
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
    """Return names and addresses under which the certificate's owner may be dialed."""
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
