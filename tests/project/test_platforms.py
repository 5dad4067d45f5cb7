"""The requirements of all first-party distributions have wheels for the machines that
docs/install.md names.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NO_NETWORK = ("error sending request", "dns error", "Failed to fetch", "Connection", "timed out")


def requirements():
    """Requirements and runtime extras of all distributions, without the distributions
    themselves.
    """
    found, ours = [], set()
    for file in (ROOT / "pyproject.toml", *ROOT.glob("[pc]*/*/pyproject.toml")):
        project = tomllib.loads(file.read_text())["project"]
        ours.add(project["name"])
        extras = project.get("optional-dependencies", {})
        found += project["dependencies"]
        found += chain(*(extras[name] for name in extras.keys() - {"dev", "docs"}))
    return {text for text in found if re.split(r"[^\w-]", text)[0] not in ours}


@pytest.mark.slow
@pytest.mark.parametrize(
    "platform",
    [
        "aarch64-manylinux_2_28",
        "x86_64-manylinux_2_28",
        "aarch64-apple-darwin",
        "x86_64-pc-windows-msvc",
    ],
)
def test_every_requirement_has_a_wheel(platform, tmp_path):
    """Resolved with the versions of constraints.txt, without installing anything."""
    command = (
        f"-m uv pip compile - -o {tmp_path}/resolved.txt -c {ROOT}/constraints.txt "
        f"--only-binary :all: --python-version 3.11 --python-platform {platform}"
    )
    done = subprocess.run(
        [sys.executable, *command.split()],
        input="\n".join(requirements()),
        env=os.environ | {"MACOSX_DEPLOYMENT_TARGET": "14.0"},
        capture_output=True,
        text=True,
    )
    if done.returncode and any(text in done.stderr for text in NO_NETWORK):
        pytest.skip(f"no package index: {done.stderr.splitlines()[0]}")
    assert done.returncode == 0, done.stderr
    resolved = (tmp_path / "resolved.txt").read_text()
    assert ("\nembreex==" in resolved) == (platform != "aarch64-manylinux_2_28")
