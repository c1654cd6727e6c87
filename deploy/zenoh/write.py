"""Writes the JSON5 configurations beside it, from the endpoint files.

    python -m deploy.zenoh.write

They are what Surefoot's own processes use, for zenohd, bridges and other tools.
"""

from __future__ import annotations

import json
from pathlib import Path

import msgspec

from surefoot.robot_io.bus.session import CONNECT_TIMEOUT_S, Role, session_config
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.endpoints import Endpoints, Tls
from surefoot.schemas.toml_file import load

HERE = Path(__file__).parent
CERTIFICATES = "/etc/surefoot/certs"
FILES = {
    "loopback-robot": ("loopback.toml", Role.ROBOT, "walker"),
    "loopback-client": ("loopback.toml", Role.CLIENT, "walker"),
    "hardware-robot": ("hardware/robot.toml", Role.ROBOT, "walker-real"),
    "hardware-stabilizer": ("hardware/stabilizer.toml", Role.CLIENT, "walker-real"),
    "routed-router": ("routed/router.toml", Role.ROUTER, "walker-real"),
    "routed-robot": ("routed/robot.toml", Role.ROBOT, "walker-real"),
    "routed-stabilizer": ("routed/stabilizer.toml", Role.CLIENT, "walker-real"),
}


def text(name: str) -> str:
    """Return one of the files."""
    endpoint_file, role, robot_name = FILES[name]
    endpoints = load(HERE.parent / endpoint_file, Endpoints)
    if endpoints.tls is not None:
        paths = msgspec.structs.asdict(endpoints.tls)
        installed = {k: f"{CERTIFICATES}/{Path(v).name}" for k, v in paths.items()}
        endpoints = msgspec.structs.replace(endpoints, tls=Tls(**installed))
    robot = load_robot(robot_name)
    config = session_config(
        endpoints,
        role,
        namespace=robot.file.namespace,
        timeout_s=CONNECT_TIMEOUT_S,
        keys=robot.keys,
    )
    head = (
        f"// Zenoh as the {role}, from deploy/{endpoint_file} and the robot "
        f"{robot_name}.\n// Written by: python -m deploy.zenoh.write\n"
    )
    return head + json.dumps(config, indent=2) + "\n"


if __name__ == "__main__":
    for each in FILES:
        (HERE / f"{each}.json5").write_text(text(each), encoding="utf-8")
