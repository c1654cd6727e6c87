"""Certificates and TLS endpoints on loopback."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import msgspec

from surefoot.robot_io.security.certificates import (
    AUTHORITY,
    _read,
    _write,
    issue,
    make_certificates,
)
from surefoot.schemas.endpoints import Endpoints, Tls
from tests.support import free_port


class Authority:
    """A folder of certificates, and endpoints for each of its identities."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        make_certificates(folder, hosts=[], days=30)
        locator = f"tls/127.0.0.1:{free_port()}"
        self._open = Endpoints(listen=[locator], connect=[locator])

    def endpoints(self, identity: str) -> Endpoints:
        """Return the common endpoints for one of the identities."""
        tls = Tls(
            ca=str(self.folder / "ca.pem"),
            certificate=str(self.folder / f"{identity}.pem"),
            key=str(self.folder / f"{identity}.key.pem"),
        )
        return msgspec.structs.replace(self._open, tls=tls)

    def issue(self, identity: str, *, days: float, now: datetime | None = None) -> None:
        """Add an identity, whose certificate may have expired."""
        issued = issue(
            identity,
            _read(self.folder, AUTHORITY),
            hosts=[],
            days=days,
            now=now or datetime.now(UTC),
        )
        _write(self.folder, {identity: issued})
