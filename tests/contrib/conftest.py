"""A clean Python environment with nothing of this project in it but the wheels that a test puts
there.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Environment:
    """A virtual environment.

    Attributes:
        folder: where it is.
        variables: of every command.
    """

    folder: Path
    variables: dict[str, str] = field(default_factory=dict)

    def run(self, command, cwd, code=0):
        """What a shell command prints; it has to end with ``code``."""
        own = {
            "PATH": f"{self.folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
            "VIRTUAL_ENV": str(self.folder),
        }
        kept = {
            k: v
            for k, v in os.environ.items()
            if not k.startswith(("PHYSIC", "PYTHON", "PIP_", "PYTEST"))
        }
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command],
            cwd=cwd,
            env=kept | self.variables | own,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == code, f"$ {command}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def install(self, *wheels):
        """Put wheels in, without what they require: that is there."""
        command = [
            sys.executable,
            "-m",
            "pip",
            "--python",
            str(self.folder / "bin" / "python"),
            "install",
        ]
        quiet = ["--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"]
        subprocess.run([*command, *quiet, *map(str, wheels)], check=True, timeout=300)


def _build(folder, into):
    """The wheel of a distribution's folder."""
    (wheel,) = WheelBuilder(str(folder)).build(directory=str(into), versions=["standard"])
    return Path(wheel)


@pytest.fixture
def build(tmp_path):
    """Builds the wheel of a distribution's folder."""
    return lambda folder: _build(folder, tmp_path / "dist")


@pytest.fixture(scope="session")
def wheels(tmp_path_factory):
    """A folder with the wheels of the core and of what the tutorial installs beside it."""
    folder = tmp_path_factory.mktemp("wheels")
    beside = ("testing", "embedded", "visual")
    for source in (ROOT, *(ROOT / "plugins" / name for name in beside)):
        _build(source, folder)
    return folder


@pytest.fixture
def environment(tmp_path, wheels):
    """Nothing of this project; of its dependencies what this Python has, by links."""
    folder = tmp_path / "venv"
    subprocess.run(
        [sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True, timeout=300
    )
    (site,) = folder.glob("lib/python*/site-packages")
    for installed in {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}:
        for entry in Path(installed).iterdir():
            if (
                not entry.name.startswith(("physic", "metricbody", "_editable_impl"))
                and entry.suffix != ".pth"
            ):
                (site / entry.name).symlink_to(entry)
    # The build backend is there, and an isolated build would have to fetch it.
    pip = (
        f'#!/bin/sh\nstep=$1; shift\nexec "{folder}/bin/python" -m pip "$step" '
        f'--no-build-isolation "$@"\n'
    )
    (folder / "bin" / "pip").write_text(pip)
    (folder / "bin" / "pip").chmod(0o755)
    (folder / "bin" / "pytest").write_text(
        f'#!/bin/sh\nexec "{folder}/bin/python" -m pytest "$@"\n'
    )
    (folder / "bin" / "pytest").chmod(0o755)
    return Environment(
        folder,
        {
            "OMP_NUM_THREADS": "1",
            "PIP_NO_INDEX": "1",
            "PIP_FIND_LINKS": str(wheels),
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        },
    )
