"""Endpoint file: where a process meets the others on the network, and its identity."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.toml_file import FileStruct, convert, read_toml, toml_text

DEFAULT_LOCATOR = "tcp/127.0.0.1:7447"
MAX_INCOMING_BYTES = 16384
_READABLE_BY_OTHERS = 0o007


class Tls(FileStruct, frozen=True, kw_only=True):
    """Certificates of this process, as ``surefoot certs`` makes them.

    Paths are relative to the endpoint file. Both ends show a certificate. A certificate
    that the authority did not sign, or that has expired, is refused.
    """

    ca: str
    """Certificate of the authority that signs all certificates (PEM)."""
    certificate: str
    """Certificate of this process (PEM); its common name is its identity."""
    key: str
    """Private key of this process (PEM); no other user may be able to read it."""


class Access(FileStruct, frozen=True, kw_only=True):
    """Common names of certificates by what they may do; the listening side checks them.

    An identity that is not listed may call the e-stop, and nothing else.
    """

    stabilizer: list[str] = msgspec.field(default_factory=lambda: ["stabilizer"])
    """May read everything, command (``cmd/**``, ``srv/**``) and send its own status."""
    operator: list[str] = msgspec.field(default_factory=lambda: ["operator"])
    """May change the stabilizer's gains, make it hold, resume and walk, push a
    simulated robot, and read everything."""
    planner: list[str] = msgspec.field(default_factory=lambda: ["planner"])
    """May send references and walk plans, and read everything."""
    observer: list[str] = msgspec.field(default_factory=lambda: ["observer"])
    """May read everything."""
    robot: list[str] = msgspec.field(default_factory=lambda: ["robot"])
    """May be the robot; checked by a router."""
    router: list[str] = msgspec.field(default_factory=lambda: ["router"])
    """May do what any other may, since it passes on their messages; it checks them
    itself."""


class Endpoints(FileStruct, frozen=True, kw_only=True):
    """Zenoh locators. The robot listens, everyone else dials.

    A file holds both sides. The robot uses ``listen``, all others use ``connect``. With
    ``router``, only the router listens, and robot and all others dial it.
    """

    listen: list[str] = msgspec.field(default_factory=lambda: [DEFAULT_LOCATOR])
    """Locators at which the robot listens."""
    connect: list[str] = msgspec.field(default_factory=lambda: [DEFAULT_LOCATOR])
    """Locators that everyone else dials; the first that answers is taken."""
    router: list[str] = []
    """Locators at which everyone, the robot included, dials the router; empty without
    one. The router itself listens at ``listen``, or here when its file has no
    ``listen``."""
    lease_ms: Annotated[int, msgspec.Meta(ge=50, le=60000)] = 500
    """Time of silence after which a peer counts as gone."""
    retry_ms: Annotated[int, msgspec.Meta(ge=10, le=10000)] = 50
    """First pause between two attempts to connect; doubles up to four times."""
    max_bytes: Annotated[int, msgspec.Meta(ge=1024, le=65536)] = MAX_INCOMING_BYTES
    """Longest message; the listening side drops longer ones unread [bytes]."""
    insecure: bool = False
    """Allow listening on addresses other than loopback without TLS."""
    tls: Tls | None = None
    """Certificates; with them every locator must be tls/ or quic/."""
    access: Access = Access()
    """Permissions by the common name of the certificate."""


def load_endpoints(path: Path) -> Endpoints:
    """Read an endpoint file; paths in it become absolute.

    Raises:
        FileFormatError: malformed, a certificate is missing, or others can read the
            private key.
    """
    table = read_toml(path)
    endpoints = convert(table, Endpoints, source=str(path))
    if endpoints.router and "listen" not in table:
        endpoints = msgspec.structs.replace(endpoints, listen=endpoints.router)
    if endpoints.tls is None:
        return endpoints
    found = {}
    for name, file in msgspec.structs.asdict(endpoints.tls).items():
        place = (path.parent / file).absolute()
        if not place.is_file():
            raise FileFormatError(
                f"{path}: tls.{name}: no such file: {place}; make it with surefoot "
                "certs, or copy it here",
                field=f"tls.{name}",
            )
        found[name] = place
    mode = found["key"].stat().st_mode
    if mode & _READABLE_BY_OTHERS:
        raise FileFormatError(
            f"{path}: tls.key: everyone can read {found['key']} (mode "
            f"{mode & 0o777:o}); chmod 600 it, or make a new one if it got around",
            field="tls.key",
        )
    tls = Tls(**{name: str(place) for name, place in found.items()})
    return msgspec.structs.replace(endpoints, tls=tls)


def choose_endpoints(
    file: Path | None,
    *,
    listen: list[str] | None = None,
    connect: list[str] | None = None,
    router: list[str] | None = None,
    insecure: bool = False,
) -> Endpoints:
    """Merge an endpoint file with options of the command line.

    Args:
        file: endpoint file, or None for the defaults.
        listen: replaces the file's ``listen``; None or empty keeps it.
        connect: replaces the file's ``connect`` and ``router``; None or empty keeps
            them.
        router: replaces the file's ``router``; None or empty keeps it.
        insecure: allow listening on addresses other than loopback without TLS.

    Raises:
        FileFormatError: the file cannot be used.
    """
    endpoints = Endpoints() if file is None else load_endpoints(file)
    changes: dict[str, Any] = {}
    if listen:
        changes["listen"] = list(listen)
    if connect:
        changes |= {"connect": list(connect), "router": []}
    if router:
        changes["router"] = list(router)
    if insecure:
        changes["insecure"] = True
    return msgspec.structs.replace(endpoints, **changes)


def write_endpoints(path: Path, endpoints: Endpoints) -> None:
    """Write endpoints without certificates so that they read back the same.

    Args:
        path: the TOML file to write.
        endpoints: what to write; paths of certificates would be relative to the file.
    """
    keys = msgspec.to_builtins(endpoints)
    if keys.pop("tls") is not None:
        raise ValueError("endpoints: got certificates, expected none to be copied")
    path.write_text(toml_text(keys), encoding="utf-8")
