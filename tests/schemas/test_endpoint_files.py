from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.schemas.endpoints import (
    Endpoints,
    Tls,
    load_endpoints,
    write_endpoints,
)
from surefoot.schemas.errors import FileFormatError

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


def test_a_misspelt_identity_list_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "endpoints.toml"
    path.write_text('[access]\nstabiliser = ["ann"]\n')
    with pytest.raises(FileFormatError, match=r"did you mean 'stabilizer'"):
        load_endpoints(path)


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
