"""Checks certificates before they are used: our own, and the other side's.

Zenoh opens a session without a word even if a certificate has expired or a key belongs
to another certificate. The peers then refuse this process, and users look for the fault
there. These checks find faults of our own side at the start.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import ssl
import threading
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.serialization import PublicFormat
from cryptography.x509.oid import ExtendedKeyUsageOID

from surefoot.robot_io.errors import CertificateError
from surefoot.robot_io.security.locators import SOCKET_FILE, place_of, protocol_of
from surefoot.schemas.endpoints import Endpoints, Tls

LOOK_S = 1.0
"""Longest look at a peer's certificate, and at the name of its host, only after the bus
has failed [s]. It is longer than a handshake."""
_RENEW = "make new ones with surefoot certs --renew"
_DATE = "%Y-%m-%d %H:%M UTC"


def peer_fault(endpoints: Endpoints, locators: list[str]) -> str:
    """Return why the other side cannot be reached at some locators, in words.

    Names of hosts are looked up; over TLS both sides' certificates are examined, ours
    by what the other side answers to it.

    Returns:
        Empty if nothing is wrong, nobody answers, or the check is not possible.
    """
    found = (_unknown_host(one) or _tls_fault(endpoints, one) for one in locators)
    return "; ".join(filter(None, found))


def _unknown_host(locator: str) -> str:
    """Return what is wrong with the name of a locator's host; empty if it is known."""
    if protocol_of(locator) == SOCKET_FILE:
        return ""
    host, port = place_of(locator)
    known = threading.Event()

    def look_up() -> None:
        with contextlib.suppress(OSError, UnicodeError):
            socket.getaddrinfo(host, port)
            known.set()

    looking = threading.Thread(target=look_up, daemon=True)
    looking.start()
    looking.join(LOOK_S)  # a lookup cannot be interrupted; without a DNS it is long
    if known.is_set():
        return ""
    return f"this machine knows no host {host!r}; write its address, or tell /etc/hosts"


def _tls_fault(endpoints: Endpoints, locator: str) -> str:
    """Return what is wrong with the certificates of a link; empty if nothing is."""
    tls = endpoints.tls
    if tls is None or protocol_of(locator) != "tls":
        return ""
    host, port = place_of(locator)
    seen = _look(tls, host, port)
    try:
        authorities = read_certificates(Path(tls.ca))
    except CertificateError:
        return ""
    if seen is None:
        return ""
    certificate, now = seen.certificate, datetime.now(UTC)
    theirs = f"the certificate at {locator}"
    if not any(_is_signed_by(certificate, one) for one in authorities):
        return f"{theirs} is of another authority than ours"
    since, until = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now > until:
        return f"{theirs} expired on {until.strftime(_DATE)}"
    if now < since:
        return (
            f"{theirs} is valid from {since.strftime(_DATE)} on, and it is "
            f"{now.strftime(_DATE)} here; set the clocks of both machines"
        )
    names = names_of(certificate)
    if not _is_among(host, names):
        return (
            f"{theirs} is for {', '.join(names) or 'no host'}, not for {host}; dial "
            f"one of these, or make it anew with surefoot certs --renew --host {host}"
        )
    return _alert_in_words(seen.alert, locator, now)


_OUT_OF_DATE = "SSLV3_ALERT_CERTIFICATE_EXPIRED"
"""OpenSSL's name of the alert to a certificate that has expired or is not valid yet."""
_STRANGE = ("TLSV1_ALERT_UNKNOWN_CA", "TLSV1_ALERT_DECRYPT_ERROR")
"""Those to one of another authority, the second where both have the same name."""


def _alert_in_words(alert: str, locator: str, now: datetime) -> str:
    """Return why the other side refuses our certificate; empty if it does not."""
    if not alert:
        return ""
    told = f"our certificate is refused at {locator}"
    if alert == _OUT_OF_DATE:
        return (
            f"{told} as out of date, and it is {now.strftime(_DATE)} here; set the "
            "clocks of both machines"
        )
    if alert in _STRANGE:
        return f"{told}: it is of another authority than those trusted there"
    return f"{told} ({alert})"


def _is_among(host: str, names: list[str]) -> bool:
    try:
        return str(ipaddress.ip_address(host)) in names
    except ValueError:
        return host.lower().removesuffix(".") in (name.lower() for name in names)


class _Seen(NamedTuple):
    """What a look at the other side of a TLS link found.

    Attributes:
        certificate: what the other side shows.
        alert: its alert to our certificate, by OpenSSL's name; empty without one.
    """

    certificate: x509.Certificate
    alert: str


def _look(tls: Tls, host: str, port: int) -> _Seen | None:
    """Look at the certificate that a peer shows; the peer itself is not trusted."""
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
            if shown is None:
                return None
            return _Seen(x509.load_der_x509_certificate(shown), _alert_on(secured))
    except (OSError, ValueError):  # ssl's errors are among them
        return None


def _alert_on(secured: ssl.SSLSocket) -> str:
    """Return the alert after a handshake, when TLS 1.3 judges our certificate."""
    try:
        secured.recv(1)
    except ssl.SSLError as error:
        return error.reason or ""
    except OSError:  # nothing comes: the peer waits for us to speak
        pass
    return ""


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
