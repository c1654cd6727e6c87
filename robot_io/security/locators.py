"""Checks locators, and refuses to offer the bus to an open network."""

from __future__ import annotations

import ipaddress
import re

from surefoot.robot_io.errors import LocatorError
from surefoot.schemas.endpoints import DEFAULT_LOCATOR, Endpoints

PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream")
SECURED = ("tls", "quic")
_LOCATOR = re.compile(r"(?:(?:tcp|tls|quic|udp|ws)/\S+:\d+|unixsock-stream/\S+)")


def check_locators(locators: list[str], *, verb: str) -> None:
    """Refuse malformed ones; Zenoh would go on dialing them until the time is up.

    Args:
        locators: where to listen or dial.
        verb: what is done there, for the message.

    Raises:
        LocatorError: one is malformed, or there is none.
    """
    bad = [locator for locator in locators if not _LOCATOR.match(locator)]
    if bad or not locators:
        raise LocatorError(
            f"cannot {verb} {', '.join(bad) or 'nowhere'}; expected "
            f"protocol/address with one of {', '.join(PROTOCOLS)}, such as "
            f"{DEFAULT_LOCATOR}",
            locators=locators,
        )


def check_encryption(endpoints: Endpoints, locators: list[str]) -> None:
    """Refuse locators that do not go together with the certificates.

    Args:
        endpoints: with or without TLS.
        locators: where this process listens or dials; well-formed.

    Raises:
        LocatorError: a plain one although there is TLS, or the reverse.
    """
    for locator in locators:
        is_secured = protocol_of(locator) in SECURED
        if is_secured and endpoints.tls is None:
            raise LocatorError(
                f"{locator} needs certificates; give an endpoint file with a [tls] "
                "table (--endpoints FILE; surefoot certs makes certificates)",
                locators=locators,
            )
        if not is_secured and endpoints.tls is not None:
            raise LocatorError(
                f"{locator} is not encrypted although there is a [tls] table; write "
                f"{' or '.join(f'{name}/' for name in SECURED)} before the address, "
                "or leave the table out",
                locators=locators,
            )


def check_exposure(endpoints: Endpoints) -> None:
    """Refuse to listen on other addresses than loopback without TLS.

    Args:
        endpoints: of a process that listens; well-formed.

    Raises:
        LocatorError: one would be open to the network.
    """
    if endpoints.insecure:
        return
    for locator in endpoints.listen:
        if protocol_of(locator) not in SECURED and not is_local(locator):
            raise LocatorError(
                f"{locator} would let anyone on that network command the robot; "
                "listen on tls/ with certificates (surefoot certs), or say "
                "--insecure (insecure = true in the endpoint file) on a network "
                "that nobody else is on",
                locators=endpoints.listen,
            )


def protocol_of(locator: str) -> str:
    """Return the protocol of a locator."""
    return locator.split("/", 1)[0]


def is_local(locator: str) -> bool:
    """Whether only this host can reach it; a name might be anywhere."""
    protocol, address = locator.split("/", 1)
    if protocol == "unixsock-stream":
        return True
    if re.search("[?#]", address):  # options, such as iface=, are not looked into
        address = re.split("[?#]", address)[0]
    host = address.rsplit(":", 1)[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
