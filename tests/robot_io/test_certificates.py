from __future__ import annotations

import ipaddress
import resource
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from surefoot.robot_io.errors import CertificateError
from surefoot.robot_io.security.certificates import (
    AUTHORITY,
    IDENTITIES,
    LISTENERS,
    make_certificates,
    renew_certificates,
)
from surefoot.robot_io.security.own_certificates import names_of

NOW = datetime(2030, 1, 1, tzinfo=UTC)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "certs"
    make_certificates(folder, hosts=["robot.lan", "192.0.2.10"], days=90, now=NOW)
    return folder


def read(folder: Path, name: str) -> x509.Certificate:
    return x509.load_pem_x509_certificate((folder / f"{name}.pem").read_bytes())


@pytest.mark.parametrize("name", IDENTITIES)
def test_each_identity_is_signed_and_carries_its_name(folder: Path, name: str) -> None:
    certificate = read(folder, name)
    certificate.verify_directly_issued_by(read(folder, AUTHORITY))
    (common,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    assert common.value == name
    assert certificate.not_valid_after_utc == NOW + timedelta(days=90)
    assert certificate.not_valid_before_utc <= NOW


@pytest.mark.parametrize("name", IDENTITIES)
def test_only_listeners_can_be_dialed_under_their_addresses(
    folder: Path, name: str
) -> None:
    extensions = read(folder, name).extensions
    names = extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    uses = extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    addresses = set(names.get_values_for_type(x509.IPAddress))
    is_listener = name in LISTENERS
    assert (ipaddress.ip_address("192.0.2.10") in addresses) is is_listener
    assert ("robot.lan" in names.get_values_for_type(x509.DNSName)) is is_listener
    assert (ExtendedKeyUsageOID.SERVER_AUTH in uses) is is_listener
    assert ExtendedKeyUsageOID.CLIENT_AUTH in uses


def test_an_identity_cannot_sign(folder: Path) -> None:
    for name in IDENTITIES:
        constraints = read(folder, name).extensions.get_extension_for_class(
            x509.BasicConstraints
        )
        assert not constraints.value.ca


def test_nobody_else_can_read_the_keys(folder: Path) -> None:
    keys = list(folder.glob("*.key.pem"))
    assert len(keys) == len(IDENTITIES) + 1
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_nothing_is_overwritten(folder: Path) -> None:
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(CertificateError, match="there already"):
        make_certificates(folder, hosts=[], days=90)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_renewing_keeps_the_authority_and_changes_all_else(folder: Path) -> None:
    before = {path: path.read_bytes() for path in folder.iterdir()}
    later = NOW + timedelta(days=80)
    renew_certificates(folder, hosts=["robot.lan"], days=90, now=later)
    kept = {path.name for path, data in before.items() if path.read_bytes() == data}
    assert kept == {"ca.pem", "ca.key.pem"}
    assert {path.name for path in folder.iterdir()} == {path.name for path in before}
    assert read(folder, "robot").not_valid_after_utc == later + timedelta(days=90)
    read(folder, "robot").verify_directly_issued_by(read(folder, AUTHORITY))


@contextmanager
def files_no_longer_than(size: int) -> Iterator[None]:
    """Limit the size of files, as a full disk does [bytes]."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


KEY_FITS = 400
"""Bytes for which the key of a pair fits, but not the certificate."""


def test_on_a_full_disk_each_key_keeps_its_certificate(folder: Path) -> None:
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert len(before[folder / "robot.key.pem"]) < KEY_FITS
    assert len(before[folder / "robot.pem"]) > KEY_FITS
    with files_no_longer_than(KEY_FITS), pytest.raises(OSError, match=r"'.*\.pem'"):
        renew_certificates(folder, hosts=[], days=90, now=NOW)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    new = folder.parent / "new"
    with files_no_longer_than(KEY_FITS), pytest.raises(OSError, match=r"new/ca\.pem"):
        make_certificates(new, hosts=[], days=90, now=NOW)
    assert not new.exists()


def test_renewing_keeps_the_hosts_and_adds_to_them(folder: Path) -> None:
    renew_certificates(folder, hosts=["198.51.100.7"], days=90, now=NOW)
    for name in LISTENERS:
        names = names_of(read(folder, name))
        assert {"robot.lan", "192.0.2.10", "198.51.100.7", name} <= set(names)
        assert not set(names) & (set(LISTENERS) - {name})


@pytest.mark.parametrize("fault", ["password", "others", "gone"])
def test_without_its_own_key_an_authority_renews_nothing(
    folder: Path, fault: str
) -> None:
    key_file = folder / "ca.key.pem"
    if fault == "password":
        key = serialization.load_pem_private_key(key_file.read_bytes(), None)
        hidden = key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.BestAvailableEncryption(b"secret"),
        )
        key_file.write_bytes(hidden)
    elif fault == "others":
        key_file.write_bytes((folder / "robot.key.pem").read_bytes())
    else:
        key_file.unlink()
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(CertificateError, match=r"ca\.key\.pem"):
        renew_certificates(folder, hosts=[], days=90, now=NOW)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_a_zone_is_refused_and_a_last_dot_left_out(tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match="with a zone"):
        make_certificates(tmp_path / "certs", hosts=["fe80::1%eth0"], days=1)
    make_certificates(tmp_path / "certs", hosts=["robot.lan."], days=1)
    assert "robot.lan" in names_of(read(tmp_path / "certs", "robot"))


def test_renewing_needs_an_authority_that_lasts(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match="no authority"):
        renew_certificates(tmp_path / "empty", hosts=[], days=90)
    with pytest.raises(CertificateError, match="valid until 2039"):
        renew_certificates(folder, hosts=[], days=90, now=NOW + timedelta(days=3600))


@pytest.mark.parametrize(
    "host",
    [
        *("röbot", "", "my robot", "robot:7447", "tls/robot", "192.0.2.10:7447"),
        *("192.0.2", "x" * 64, "a..b"),
    ],
)
def test_a_host_that_is_none_leaves_nothing_behind(tmp_path: Path, host: str) -> None:
    with pytest.raises(CertificateError, match="neither an address nor a name"):
        make_certificates(tmp_path / "certs", hosts=[host], days=1)
    assert not (tmp_path / "certs").exists()


def test_a_folder_of_something_else_gets_no_private_keys(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text("{}")
    for folder in (tmp_path, tmp_path / "result.json"):
        with pytest.raises(CertificateError, match="name one"):
            make_certificates(folder, hosts=[], days=1)
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]
