"""Malformed user files: half edited, wrongly copied, in other units."""

from __future__ import annotations

import random
import re

ODD_VALUES = (
    *(
        "nan",
        "inf",
        "-inf",
        "-1",
        "0",
        "1e300",
        "-1e300",
        "1e-300",
        "99999999999999999",
    ),
    *(
        '""',
        '"text"',
        '"\\u0000"',
        "true",
        "[]",
        "[1]",
        "[[1, 2], [3]]",
        "{}",
        "{a = 1}",
    ),
    *("1979-05-27", "'../..'", '"a/../b"', "0x10", "= 3", '"unclosed', "\u00e9", "1 2"),
)
ODD_WORDS = (
    *("nan", "inf", "-1", "0", "1e300", "", "text", "0 0 0", "1 2", "1e400", "0 nan 0"),
    *("continuous", "planar", "floating", "torso", "left_sole", "world", "base"),
    *("package://x/a.stl", "a b c", "&#x1F600;", "-0.001", "1000", "../x"),
)


def malformed_toml(text: str, seed: int) -> bytes:
    """Return a changed copy of a TOML; most are wrong, some are only unusual."""
    rng = random.Random(seed)
    lines = text.splitlines()
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = rng.randrange(len(lines))
        keyed = [
            i for i, line in enumerate(lines) if re.match(r"\s*[\w.\"]+\s*=", line)
        ]
        where = rng.choice(keyed) if keyed else at
        match rng.randrange(9):
            case 0 | 1 | 2:
                key = lines[where].split("=")[0]
                lines[where] = f"{key}= {rng.choice(ODD_VALUES)}"
            case 3:
                key, _, value = lines[where].partition("=")
                lines[where] = f"{key.rstrip()}x = {value}"
            case 4:
                del lines[where]
            case 5:
                lines.insert(at, rng.choice(lines))
            case 6:
                lines[at] = lines[at][: rng.randrange(len(lines[at]) + 1)]
            case 7:
                lines.insert(
                    at, rng.choice(("[", "[[a]]", "[a.b]", "x", "= 1", "\x01"))
                )
            case 8:
                numbers = re.findall(r"-?\d+\.?\d*", lines[where].partition("=")[2])
                if numbers:
                    old = rng.choice(numbers)
                    new = f"{float(old) * rng.choice((-1.0, 1e-3, 57.3, 1e3, 1e9)):g}"
                    key, _, value = lines[where].partition("=")
                    lines[where] = f"{key}={value.replace(old, new, 1)}"
        if not lines:
            break
    data = "\n".join(lines).encode()
    if rng.random() < 0.1 and data:
        at = rng.randrange(len(data))
        data = data[:at] + rng.randbytes(3) + data[at:]
    return data


def malformed_urdf(text: str, seed: int) -> bytes:
    """Return a changed copy of a URDF."""
    rng = random.Random(seed)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        attributes = list(re.finditer(r'(\w+)="([^"]*)"', text))
        # Shapes make up most of a file, and least of what can be wrong with it.
        telling = [
            found
            for found in attributes
            if found[1] not in ("rgba", "size", "radius", "length")
        ]
        elements = list(re.finditer(r"<(\w+)[^>]*/>", text))
        found, element = rng.choice(telling), rng.choice(elements)
        match rng.randrange(8):
            case 0 | 1 | 2 | 3:
                text = _replaced(text, found.span(2), rng.choice(ODD_WORDS))
            case 4:
                other = rng.choice(telling)
                text = _replaced(text, found.span(2), other[2])
            case 5:
                text = _replaced(text, element.span(), "")
            case 6:
                text = _replaced(text, found.span(), "")
            case 7:
                blocks = list(re.finditer(r"<(joint|link) .*?</\1>", text, re.DOTALL))
                block = rng.choice(blocks)
                again = rng.random() < 0.5
                text = _replaced(text, block.span(), block[0] * 2 if again else "")
    data = text.encode()
    if rng.random() < 0.1:
        at = rng.randrange(len(data))
        data = data[:at] + rng.randbytes(3) + data[at + rng.randrange(4) :]
    return data


def _replaced(text: str, span: tuple[int, int], new: str) -> str:
    return text[: span[0]] + new + text[span[1] :]
