"""The processes of a run get the endpoints whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.endpoints import write_endpoints
from surefoot.schemas.endpoints import Endpoints, Tls, load_endpoints


def test_endpoints_read_back_as_they_were(tmp_path: Path) -> None:
    endpoints = Endpoints(
        listen=["tcp/127.0.0.1:7001", "tcp/127.0.0.1:7002"],
        connect=["tcp/127.0.0.1:7001"],
        lease_ms=1234,
        retry_ms=77,
        max_bytes=20000,
        insecure=True,
    )
    path = tmp_path / "endpoints.toml"
    write_endpoints(path, endpoints)
    assert load_endpoints(path) == endpoints


def test_certificates_are_not_copied(tmp_path: Path) -> None:
    secret = Endpoints(tls=Tls(ca="ca.pem", certificate="me.pem", key="me.key"))
    with pytest.raises(ValueError, match="expected none"):
        write_endpoints(tmp_path / "endpoints.toml", secret)
