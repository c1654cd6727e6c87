"""Zenoh's access control, written out for a robot's keys.

The listening side, robot or router, enforces it on what comes in and what goes out;
nothing depends on the good will of who dials.
"""

from __future__ import annotations

from surefoot.schemas.arrays import JsonObject
from surefoot.schemas.endpoints import Access
from surefoot.schemas.topics import ALIVE_ROBOT, ALIVE_STABILIZER, TOPICS, Direction

INGRESS, EGRESS = ["ingress"], ["egress"]
ESTOP = "estop"
PUSH = "push"


def access_control(
    access: Access, *, keys: dict[str, str], namespace: str
) -> JsonObject:
    """Return the rules by identity; what no rule allows is dropped.

    Args:
        access: common names by what they may do.
        keys: channel name to key, the robot file's overrides applied.
        namespace: the robot's, put before every key.

    Returns:
        Zenoh's ``access_control``.
    """
    may = {
        "stabilizer": ["command", "ask", "serve", "live", "read", "hear"],
        "operator": ["operate", "plan", "read", "hear"],
        "planner": ["plan", "read", "hear"],
        "observer": ["read", "hear"],
        "robot": ["robot-put", "robot-answer", "robot-live", "read", "hear"],
        "router": [
            *("command", "ask", "serve", "operate", "live", "plan", "read", "hear"),
        ],
    }
    policies = [
        {"rules": may[group], "subjects": [f"{group}s"]}
        for group, names in _groups(access).items()
        if names
    ]
    subjects: list[JsonObject] = [
        {"id": f"{group}s", "cert_common_names": names}
        for group, names in _groups(access).items()
        if names
    ]
    # Whoever got through the handshake has a certificate of ours, listed or not.
    subjects.append({"id": "anyone"})
    policies.append({"rules": ["stop", "stop-answer"], "subjects": ["anyone"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": _rules(keys, namespace),
        "subjects": subjects,
        "policies": policies,
    }


def _groups(access: Access) -> dict[str, list[str]]:
    return {
        "stabilizer": access.stabilizer,
        "operator": access.operator,
        "planner": access.planner,
        "observer": access.observer,
        "robot": access.robot,
        "router": access.router,
    }


def _rules(keys: dict[str, str], namespace: str) -> list[JsonObject]:
    def of(*directions: Direction) -> list[str]:
        """Return the full keys of all channels of some directions but the e-stop."""
        return [
            f"{namespace}/{keys[topic.name]}"
            for topic in TOPICS
            if topic.direction in directions and topic.name != ESTOP
        ]

    everything = [f"{namespace}/**"]
    estop = [f"{namespace}/{keys[ESTOP]}"]
    services = of(Direction.SERVICE)
    of_stabilizer = of(Direction.STABILIZER_SERVICE)
    push = f"{namespace}/{keys[PUSH]}"
    commander = [f"{namespace}/{ALIVE_STABILIZER}/*"]
    return [
        _rule("read", INGRESS, everything, *_SUBSCRIBE),
        _rule("hear", EGRESS, everything, *_TOLD),
        _rule("stop", INGRESS, estop, "query"),
        _rule("stop-answer", EGRESS, estop, "declare_queryable", "reply"),
        _rule(
            "command",
            INGRESS,
            of(Direction.TO_ROBOT, Direction.FROM_STABILIZER),
            "put",
        ),
        _rule("ask", INGRESS, services, "query"),
        _rule("serve", INGRESS, of_stabilizer, *_ANSWER),
        _rule("operate", INGRESS, [*of_stabilizer, push], "query"),
        _rule("live", INGRESS, commander, "liveliness_token"),
        _rule("plan", INGRESS, of(Direction.TO_STABILIZER), "put"),
        _rule("robot-put", INGRESS, of(Direction.FROM_ROBOT), "put"),
        _rule("robot-answer", INGRESS, [*services, *estop], *_ANSWER),
        _rule(
            "robot-live", INGRESS, [f"{namespace}/{ALIVE_ROBOT}/**"], "liveliness_token"
        ),
    ]


_SUBSCRIBE = (
    "declare_subscriber",
    "declare_liveliness_subscriber",
    "liveliness_query",
)
_ANSWER = ("declare_queryable", "reply")
_TOLD = ("put", "query", "liveliness_token", *_ANSWER, *_SUBSCRIBE)
"""Everything a listed identity may be sent; it may send only what other rules say."""


def _rule(name: str, flows: list[str], keys: list[str], *messages: str) -> JsonObject:
    return {
        "id": name,
        "permission": "allow",
        "flows": flows,
        "messages": list(messages),
        "key_exprs": keys,
    }
