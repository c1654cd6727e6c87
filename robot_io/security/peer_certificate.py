"""Looks at the certificate of whoever is dialed, to say why no link came about."""

from __future__ import annotations

import ipaddress
import socket
import ssl
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509

from surefoot.robot_io.errors import CertificateError
from surefoot.robot_io.security.locators import place_of, protocol_of
from surefoot.robot_io.security.own_certificates import (
    _is_signed_by,
    names_of,
    read_certificates,
)
from surefoot.schemas.endpoints import Endpoints

LOOK_S = 1.0
"""Longer than a handshake takes; only after the bus has failed [s]."""


def peer_fault(endpoints: Endpoints, locators: list[str]) -> str:
    """What is wrong with the certificates at some places, in words.

    Args:
        endpoints: with certificates of ours.
        locators: that were dialed.

    Returns:
        Empty where nothing is wrong, nobody answers, or it cannot be looked at.
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
    """The certificate somebody shows; nothing it says is trusted."""
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
