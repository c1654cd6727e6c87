"""Endpoint file: where a process meets the others on the network, and as whom."""

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

    Paths are relative to the endpoint file. Both ends show a certificate; one that the
    authority did not sign, or that has expired, is turned away.
    """

    ca: str
    """Certificate of the authority that signs everyone's (PEM)."""
    certificate: str
    """Certificate of this process (PEM); its common name is its identity."""
    key: str
    """Private key of this process (PEM); nobody else may read it."""


class Access(FileStruct, frozen=True, kw_only=True):
    """Common names by what they may do; used with TLS by who listens.

    An identity without a place here may call the e-stop, and nothing else.
    """

    stabilizer: list[str] = msgspec.field(default_factory=lambda: ["stabilizer"])
    """May command: ``cmd/**``, ``srv/**``, its own status; and read everything."""
    operator: list[str] = msgspec.field(default_factory=lambda: ["operator"])
    """May change the stabilizer's gains, have it hold, resume and walk, push a
    simulated robot; and read everything."""
    planner: list[str] = msgspec.field(default_factory=lambda: ["planner"])
    """May send references, and read everything."""
    observer: list[str] = msgspec.field(default_factory=lambda: ["observer"])
    """May read everything."""
    robot: list[str] = msgspec.field(default_factory=lambda: ["robot"])
    """May be the robot; a router asks."""
    router: list[str] = msgspec.field(default_factory=lambda: ["router"])
    """Passes on what others say, so it may do what they may; it checks them."""


class Endpoints(FileStruct, frozen=True, kw_only=True):
    """Zenoh locators. The robot listens, everyone else dials.

    A file holds both sides; each process uses its own: the robot ``listen``, the
    others ``connect``. With ``router``, all of them dial that instead, and it is the
    router that listens.
    """

    listen: list[str] = msgspec.field(default_factory=lambda: [DEFAULT_LOCATOR])
    """Locators where the robot listens."""
    connect: list[str] = msgspec.field(default_factory=lambda: [DEFAULT_LOCATOR])
    """Locators that everyone else dials."""
    router: list[str] = []
    """Where everyone dials the router, when there is one, also the robot. The router
    itself listens at ``listen``, or here when its file says no ``listen``."""
    lease_ms: Annotated[int, msgspec.Meta(ge=50, le=60000)] = 500
    """Silence after which a peer counts as gone."""
    retry_ms: Annotated[int, msgspec.Meta(ge=10, le=10000)] = 50
    """First pause between two attempts to connect; doubles up to four times."""
    max_bytes: Annotated[int, msgspec.Meta(ge=1024, le=65536)] = MAX_INCOMING_BYTES
    """Whoever listens drops longer messages before anything reads them [bytes]."""
    insecure: bool = False
    """Listen on other addresses than loopback although there is no TLS."""
    tls: Tls | None = None
    """Certificates; every locator must then be tls/ or quic/."""
    access: Access = Access()
    """Who may do what, by the common name of the certificate."""


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
    """Join an endpoint file and the command line.

    Args:
        file: endpoint file, or None for the defaults.
        listen: replaces the file's ``listen`` unless there are none.
        connect: replaces the file's ``connect`` and ``router`` unless there are none.
        router: replaces the file's ``router`` unless there are none.
        insecure: listen on other addresses than loopback without TLS.

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
    """Write endpoints without certificates, such that they read back the same.

    Args:
        path: of the TOML.
        endpoints: what to write; paths of certificates would be relative to the file.
    """
    keys = msgspec.to_builtins(endpoints)
    if keys.pop("tls") is not None:
        raise ValueError("endpoints: got certificates, expected none to be copied")
    path.write_text(toml_text(keys), encoding="utf-8")
