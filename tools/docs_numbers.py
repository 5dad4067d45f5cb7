"""The numbers that pictures of the documentation show: written beside the pictures, and compared.

``docs/pictures/numbers/NAME.json`` has those of one result, and lists the pictures that were drawn
from it; ``pages.py`` writes them into pages.
"""

from __future__ import annotations

import json
import math
import re
import subprocess
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types.contacts import part_words

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from physic_core import Reconstruction
    from physic_core.types import Person

ROOT = Path(__file__).resolve().parents[1]
NUMBERS = ROOT / "docs" / "pictures" / "numbers"
CODE = ("physic_core", "plugins")
COMMAND = "make pictures"
"""What renews pictures, numbers and lines; messages name it."""

FOCAL_SHARE = 0.02
DISTANCE_SHARE = 0.05
PROBABILITY = 0.1
"""How far two machines may be apart: the libraries' kernels round differently."""
LIKELY = 0.5
"""Probability from which contacts are named."""
TEXT_SHARE = 0.05
TEXT_DIFFERENCE = 0.05
"""The same for numbers in printed text, whose meaning is not known: either bound suffices."""


def numbers_of(result: Reconstruction) -> dict[str, Any]:
    """Return focal length in px of a result, and of each person distance in m and contacts."""
    return {
        "failed_checks": _failed(result, None),
        "focal_px": round(result.intrinsics.fx),
        "people": [
            {
                "failed_checks": _failed(result, i),
                "distance_m": round(float(np.linalg.norm(person.joints[0])), 1)
                if len(person.joints)
                else None,
                "touches": _touches(person),
            }
            for i, person in enumerate(result.people)
        ],
    }


def _touches(person: Person) -> dict[str, float]:
    """Return what each part probably touches, "left foot: floor", with the probability; only what
    pixels show.
    """
    probability_of: dict[str, float] = {}
    for one in person.contacts:
        if one.likely and not one.assumed:
            partner = (
                one.partner.title
                if one.partner.kind != "scene"
                else one.partner.surface or "a surface"
            )
            name = f"{part_words(one.part)}: {partner}"
            probability_of[name] = max(
                probability_of.get(name, 0.0), round(one.probability or 1.0, 2)
            )
    return dict(sorted(probability_of.items()))


def _failed(result: Reconstruction, person: int | None) -> list[str]:
    return [check.title for check in result.checks if check.failed and check.person == person]


def differences(shown: Mapping[str, Any], measured: Mapping[str, Any]) -> list[str]:
    """Say in which numbers a picture is wrong: one line each, none if all agree."""
    old, new = shown["people"], measured["people"]
    focal = shown["focal_px"], measured["focal_px"]
    pairs: dict[str, tuple[Any, Any, float]] = {
        "failed checks": (shown["failed_checks"], measured["failed_checks"], 0.0),
        "focal length, px": (*focal, FOCAL_SHARE * focal[1]),
        "number of people": (len(old), len(new), 0.0),
    }
    for i, (one, other) in enumerate(zip(old, new, strict=False)):
        checks, distance = ((one[k], other[k]) for k in ("failed_checks", "distance_m"))
        pairs[f"failed checks of person {i}"] = (*checks, 0.0)
        pairs[f"distance of person {i}, m"] = (*distance, DISTANCE_SHARE * (distance[1] or 0.0))
        for what in sorted({*one["touches"], *other["touches"]}):
            touch = one["touches"].get(what, LIKELY), other["touches"].get(what, LIKELY)
            pairs[f"probability of contact of person {i}, {what}"] = (*touch, PROBABILITY)
    return [
        f"{what}: {a} is shown, {b} is measured"
        for what, (a, b, margin) in pairs.items()
        if not is_near(a, b, margin)
    ]


def is_near(shown: Any, measured: Any, margin: float) -> bool:
    """Compare two numbers within a margin, and anything else exactly."""
    numeric = isinstance(shown, (int, float)) and isinstance(measured, (int, float))
    return abs(shown - measured) <= margin + 1e-9 if numeric else bool(shown == measured)


def text_differences(shown: str, measured: str) -> list[str]:
    """Compare printed text line by line: numbers within a tolerance, the words between them
    exactly.
    """
    pairs = zip_longest(shown.splitlines(), measured.splitlines(), fillvalue="")
    return [f"{a!r} is shown, {b!r} is printed" for a, b in pairs if not _same_line(a, b)]


def _same_line(shown: str, measured: str) -> bool:
    number = re.compile(r"-?\d+(?:\.\d+)?")
    words = [re.sub(r"\s+", " ", number.sub("#", line)) for line in (shown, measured)]
    pairs = zip(number.findall(shown), number.findall(measured), strict=False)
    close = (
        math.isclose(float(a), float(b), rel_tol=TEXT_SHARE, abs_tol=TEXT_DIFFERENCE)
        for a, b in pairs
    )
    return words[0] == words[1] and all(close)


def caption(numbers: Mapping[str, Any]) -> str:
    """Return the line of a page: each person, and the checks that fail."""
    sentences = [f"Photo{_failing(numbers)}"] if numbers["failed_checks"] else []
    for i, person in enumerate(numbers["people"]):
        distance = (
            "without a body" if person["distance_m"] is None else f"{person['distance_m']} m away"
        )
        touches = (
            ", ".join(name.replace(": ", " touches ") for name in person["touches"])
            or "touches nothing"
        )
        text = f"Person {i}: {distance}, {touches}{_failing(person)}"
        sentences.append(text)
    return ". ".join(sentences) + "."


def _failing(numbers: Mapping[str, Any]) -> str:
    return f"; failed: {', '.join(numbers['failed_checks'])}" if numbers["failed_checks"] else ""


def read_numbers() -> dict[str, dict[str, Any]]:
    """Return what ``docs/pictures/numbers`` holds, by name."""
    return {
        file.stem: json.loads(file.read_text(encoding="utf-8"))
        for file in sorted(NUMBERS.glob("*.json"))
    }


def write_numbers(name: str, source: str, pictures: Iterable[str], result: Reconstruction) -> None:
    """Write the numbers of a result, with its photo or world, the commit, and the pictures that
    show it.
    """
    content = {
        "of": source,
        "commit": commit_of_code(),
        "pictures": sorted(pictures),
        **numbers_of(result),
    }
    NUMBERS.mkdir(parents=True, exist_ok=True)
    (NUMBERS / f"{name}.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def commit_of_code() -> str:
    """Return the last commit that changed the code, which figures are of."""
    return git("log", "-1", "--format=%h", "--abbrev=7", "--", *CODE)


def git(*arguments: str) -> str:
    """Return what git prints in this checkout."""
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()
