"""Image and compose files fit this release."""

from __future__ import annotations

import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
import typer
import yaml

from surefoot.cli.app import app
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.toml_file import load
from tests.command import REPOSITORY

DOCKER = REPOSITORY / "deploy" / "docker"
DIRECT = ("compose.yaml",)
ROUTED = ("compose.yaml", "routed.yaml")
PORT = 7447


def read(name: str) -> dict:
    return yaml.safe_load((DOCKER / name).read_text(encoding="utf-8"))


def services(*names: str) -> dict[str, dict]:
    """Return the services of the compose files, merged."""
    merged: dict[str, dict] = {}
    for name in names:
        for service, keys in read(name)["services"].items():
            there = merged.setdefault(service, {})
            health = {**there.get("healthcheck", {}), **keys.get("healthcheck", {})}
            there.update(keys)
            if health:
                there["healthcheck"] = health
    return merged


def secrets() -> dict[str, dict]:
    return {**read("compose.yaml")["secrets"], **read("routed.yaml")["secrets"]}


def cases() -> list[object]:
    return [
        pytest.param(files, name, id=f"{files[-1]}-{name}")
        for files in (DIRECT, ROUTED)
        for name in services(*files)
    ]


def endpoint_file(service: dict) -> Path:
    command = service["command"]
    inside = command[command.index("--endpoints") + 1]
    assert "./endpoints:/endpoints:ro" in service["volumes"]
    return DOCKER / inside.removeprefix("/")


@pytest.mark.parametrize(("files", "name"), cases())
def test_the_command_line_parses(files: tuple[str, ...], name: str) -> None:
    (command, *arguments) = map(str, services(*files)[name]["command"])
    known = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    known[command].make_context(command, arguments)  # refuses what it does not know


@pytest.mark.parametrize(("files", "name"), cases())
def test_a_service_gets_its_own_certificate_and_no_other(
    files: tuple[str, ...], name: str
) -> None:
    service = services(*files)[name]
    tls = load(endpoint_file(service), Endpoints).tls
    assert tls is not None
    named = {tls.ca, tls.certificate, tls.key}
    assert named == {f"/run/secrets/{secret}" for secret in service["secrets"]}
    for secret in service["secrets"]:
        assert secrets()[secret] == {"file": f"./certs/{secret}"}


@pytest.mark.parametrize(("files", "name"), cases())
def test_services_dial_the_one_that_listens(files: tuple[str, ...], name: str) -> None:
    there = services(*files)
    endpoints = load(endpoint_file(there[name]), Endpoints)
    (dialed,) = endpoints.router or endpoints.connect
    listener = "router" if "router" in there else "robot"
    assert dialed == f"tls/{listener}:{PORT}"
    (check,) = [
        word
        for word in there[name].get("healthcheck", {"test": [f":{PORT:X}"]})["test"]
        if f":{PORT:X}" in word
    ]
    if name != "recorder":
        assert (" 0A " in check) == (name == listener)  # listens; else connected


@pytest.mark.parametrize(("files", "name"), cases())
def test_who_is_waited_for_has_a_health_check(
    files: tuple[str, ...], name: str
) -> None:
    there = services(*files)
    for needed, how in there[name].get("depends_on", {}).items():
        assert how == {"condition": "service_healthy"}
        assert "healthcheck" in there[needed]


@pytest.mark.parametrize(("files", "name"), cases())
def test_nothing_is_mounted_inside_what_is_read_only(
    files: tuple[str, ...], name: str
) -> None:
    """The engine would have to make the mount point, and cannot."""
    volumes = [volume.split(":") for volume in services(*files)[name]["volumes"]]
    fixed = [target for _, target, *mode in volumes if mode == ["ro"]]
    for _, target, *_ in volumes:
        assert not any(target.startswith(f"{parent}/") for parent in fixed)


def test_the_image_gets_every_package_and_little_else() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    include = project["tool"]["setuptools"]["packages"]["find"]["include"]
    needed = {name.removesuffix("*") for name in include}
    links = (REPOSITORY / "surefoot").iterdir()  # the packages it is made of
    needed |= {path.name for path in links if path.is_symlink()}
    needed |= {"pyproject.toml", "constraints.txt", project["project"]["readme"]}
    needed |= set(project["project"]["license-files"])
    lines = (DOCKER / "Dockerfile").read_text(encoding="utf-8").splitlines()
    copied = [line.split()[1:-1] for line in lines if line.startswith("COPY ")]
    assert {name for names in copied for name in names} == needed
    ignore = (REPOSITORY / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert "*" in ignore
    assert {line[1:] for line in ignore if line.startswith("!")} == needed


def test_containers_can_write_where_they_are_told_to() -> None:
    there = services(*DIRECT)
    text = (DOCKER / "Dockerfile").read_text(encoding="utf-8")
    assert "--owner surefoot --group surefoot /recordings" in text
    for name in ("recorder", "stabilizer"):
        assert "recordings:/recordings" in there[name]["volumes"]
    assert there["recorder"]["command"][-1].startswith("/recordings/")
    assert there["stabilizer"]["working_dir"] == "/recordings"


@pytest.mark.parametrize("files", [DIRECT, ROUTED], ids=lambda files: files[-1])
def test_docker_compose_takes_the_files(files: tuple[str, ...]) -> None:
    """Need the client with its compose plugin, no engine."""
    docker = shutil.which("docker")
    if docker is None or not _has_compose(docker):
        pytest.skip("no docker compose here (the plugin docker-compose-v2)")
    named = [word for name in files for word in ("-f", str(DOCKER / name))]
    done = subprocess.run(
        [docker, "compose", *named, "--profile", "record", "config", "--quiet"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def _has_compose(docker: str) -> bool:
    done = subprocess.run(
        [docker, "compose", "version"], capture_output=True, check=False
    )
    return done.returncode == 0
