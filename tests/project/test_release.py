"""One archive installs the project where there is neither checkout nor make, and works there."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import stat
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("release")
    subprocess.run([sys.executable, str(ROOT / "tools" / "release.py"), str(folder)], check=True)
    (path,) = folder.iterdir()
    return path


def test_the_archive_has_all_distributions_and_the_digest_of_each_file(archive):
    with zipfile.ZipFile(archive) as opened:
        content = {name: opened.read(name) for name in opened.namelist()}
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    wheels = {name.split("/")[1].split("-")[0] for name in content if name.startswith("wheels/")}
    listed = {f"metricbody_{line.split('/')[-1]}" for line in lines if "/" in line}
    assert wheels == listed | {"metricbody"}
    sums = dict(line.split("  ")[::-1] for line in content["SHA256SUMS"].decode().splitlines())
    assert set(sums) == set(content) - {"SHA256SUMS", "__main__.py"}
    assert {"licenses/LICENSE", "licenses/NOTICE", "sbom.json"} <= set(sums)
    for name in ("CHANGELOG.md", "CITATION.cff", "constraints.txt"):
        assert content[name] == (ROOT / name).read_bytes()
    for name, digest in sums.items():
        assert hashlib.sha256(content[name]).hexdigest() == digest


def test_the_changelog_and_the_citation_state_the_version_and_its_date():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    dated = re.search(r"^## (\S+) - (\d{4}-\d\d-\d\d)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    cited = dict(re.findall(r"^([a-z-]+): (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M))
    assert dated is not None
    assert (project["version"], cited["date-released"]) == dated.groups()
    assert cited["version"] == project["version"]


def test_a_damaged_archive_installs_nothing(archive, tmp_path):
    damaged = tmp_path / archive.name
    with zipfile.ZipFile(archive) as opened, zipfile.ZipFile(damaged, "w") as written:
        for name in opened.namelist():
            if not name.startswith("wheels/metricbody_embedded"):
                changed = b"numpy==0\n" if name == "constraints.txt" else opened.read(name)
                written.writestr(name, changed)
    done = subprocess.run(
        [sys.executable, str(damaged)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "constraints.txt" in done.stderr
    assert not (tmp_path / "physic").exists()


@pytest.mark.slow
def test_two_commands_lead_from_the_archive_to_a_result(archive, tmp_path):
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    environment = own | {"PATH": "/usr/bin:/bin", "PHYSIC_CACHE": str(tmp_path / "cache")}
    subprocess.run([sys.executable, str(archive)], cwd=tmp_path, env=environment, check=True)
    installed = tmp_path / "physic"
    paths = [path for path in (installed, *installed.rglob("*")) if not path.is_symlink()]
    for path in paths:
        path.chmod(path.stat().st_mode & ~(stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.copy(ROOT / "examples" / "slope.jpg", elsewhere / "photo.jpg")
    try:
        command = [str(installed / "bin" / "physic"), "run", "photo.jpg"]
        subprocess.run(command, cwd=elsewhere, env=environment, check=True)
    finally:
        for path in paths:
            path.chmod(path.stat().st_mode | stat.S_IWUSR)
    assert (elsewhere / "photo-physic" / "report.html").stat().st_size > 0
