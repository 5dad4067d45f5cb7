"""contrib/README.md, followed as its reader would: every block in order, in an empty folder."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "contrib" / "README.md"
NUMBER = re.compile(r"\d+(\.\d+)?(e-\d+)?")


@dataclass(frozen=True)
class Block:
    """A block of code, and the file that the line before it names."""

    language: str
    text: str
    file: str


def blocks():
    found = re.finditer(
        r"(?P<before>[^\n]*)\n\n^```(?P<language>\w+)\n(?P<text>.*?)^```",
        PAGE.read_text(),
        re.M | re.S,
    )
    return [
        Block(
            m["language"],
            m["text"],
            "".join(re.findall(r"`([\w./-]+\.(?:py|toml))`", m["before"])[-1:]),
        )
        for m in found
    ]


def spaced(text):
    """A line without what differs from machine to machine: numbers, except counts of checks, and
    widths of columns.
    """
    return re.sub(r"\s+", " ", text if " checks: " in text else NUMBER.sub("N", text)).strip()


def test_the_tutorial_holds_from_the_first_block_to_the_last(environment, wheels, tmp_path):
    first, *rest = blocks()
    assert first.text.splitlines() == [
        "python3 -m venv .venv",
        ". .venv/bin/activate",
        "pip install -c ~/physic/constraints.txt -e ~/physic \\",
        "    -e ~/physic/plugins/testing -e ~/physic/plugins/embedded -e ~/physic/plugins/visual",
    ]
    assert all((ROOT / name).exists() for name in re.findall(r"~/physic/(\S+)", first.text))
    environment.install(*wheels.glob("*.whl"))
    folder = tmp_path / "empty"
    said = ""
    folder.mkdir()
    for block in rest:
        if block.language == "sh":
            command = block.text.replace("~/physic", str(ROOT))
            printed = environment.run(f"{command}\npwd", folder)
            said, _, place = printed.rstrip("\n").rpartition("\n")
            folder = Path(place)
        elif block.language == "text":
            lines = {spaced(line) for line in said.splitlines()}
            for line in block.text.splitlines():
                assert any(spaced(line) in other for other in lines), f"{line!r} is not in:\n{said}"
        else:
            assert block.file, f"which file is this? {block.text[:80]}"
            (folder / block.file).write_text(block.text)
