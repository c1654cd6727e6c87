from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.schemas.endpoints import (
    DEFAULT_LOCATOR,
    Endpoints,
    Tls,
    load_endpoints,
    write_endpoints,
)
from surefoot.schemas.errors import FileFormatError

DEPLOY = Path(__file__).parents[2] / "deploy"
TLS = '[tls]\nca = "certs/ca.pem"\ncertificate = "certs/me.pem"\nkey = "certs/me.key"\n'


def write(folder: Path, *, key_mode: int = 0o600) -> Path:
    (folder / "certs").mkdir()
    for name in ("ca.pem", "me.pem", "me.key"):
        (folder / "certs" / name).touch()
    (folder / "certs" / "me.key").chmod(key_mode)
    path = folder / "endpoints.toml"
    path.write_text(TLS)
    return path


def test_certificates_are_looked_for_beside_the_file(tmp_path: Path) -> None:
    endpoints = load_endpoints(write(tmp_path))
    assert endpoints.tls is not None
    assert endpoints.tls.ca == str(tmp_path / "certs" / "ca.pem")


def test_a_missing_certificate_is_named(tmp_path: Path) -> None:
    path = write(tmp_path)
    (tmp_path / "certs" / "me.pem").unlink()
    with pytest.raises(FileFormatError, match=r"tls.certificate: no such file.*certs"):
        load_endpoints(path)


@pytest.mark.parametrize("mode", [0o644, 0o604, 0o666])
def test_a_key_that_everyone_can_read_is_refused(tmp_path: Path, mode: int) -> None:
    with pytest.raises(FileFormatError, match=r"tls.key: everyone.*chmod 600"):
        load_endpoints(write(tmp_path, key_mode=mode))


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


def test_endpoints_default_to_loopback(tmp_path: Path) -> None:
    path = tmp_path / "endpoints.toml"
    path.write_text("# as by default")
    assert load_endpoints(path) == Endpoints()
    path.write_text("\n")  # all that is left of a file that was cut off
    with pytest.raises(FileFormatError, match=r"endpoints\.toml: is empty"):
        load_endpoints(path)
    assert Endpoints().listen == Endpoints().connect == [DEFAULT_LOCATOR]


def test_endpoints_load_and_refuse(tmp_path: Path) -> None:
    path = tmp_path / "endpoints.toml"
    path.write_text('connect = ["tcp/192.0.2.1:7447"]\nlease_ms = 800')
    endpoints = load_endpoints(path)
    assert endpoints.connect == ["tcp/192.0.2.1:7447"]
    assert endpoints.lease_ms == 800
    path.write_text("lease_ms = 1")
    with pytest.raises(FileFormatError, match=r"endpoints\.toml: lease_ms"):
        load_endpoints(path)
    for text, meant in (
        ('conect = ["tcp/192.0.2.1:7447"]', "connect"),
        ('[access]\nstabiliser = ["ann"]', "stabilizer"),
    ):
        path.write_text(text)
        with pytest.raises(FileFormatError, match=f"did you mean '{meant}'"):
            load_endpoints(path)


def test_shipped_loopback_file_says_what_the_defaults_are() -> None:
    assert load_endpoints(DEPLOY / "loopback.toml") == Endpoints()


def test_defaults_are_not_shared() -> None:
    Endpoints().listen.append("tcp/192.0.2.1:7447")
    assert Endpoints().listen == [DEFAULT_LOCATOR]
