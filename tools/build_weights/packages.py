"""Files out of registry packages and repositories, by name and version, through their own clients,
checked by hash.
"""

from __future__ import annotations

import base64
import hashlib
import subprocess
import sys
import tarfile
from dataclasses import dataclass
from pathlib import Path


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@dataclass(frozen=True)
class NpmPackage:
    """An npm package; ``integrity`` is the registry's own sha512."""

    name: str
    version: str
    integrity: str


@dataclass(frozen=True)
class PypiSource:
    """A source distribution on PyPI."""

    name: str
    version: str
    sha256: str


@dataclass(frozen=True)
class GithubFile:
    """A file of a GitHub repository (owner/name) at a commit."""

    repository: str
    commit: str
    path: str
    sha256: str


@dataclass(frozen=True)
class Cache:
    """A folder for what was fetched."""

    folder: Path

    def npm_file(self, package: NpmPackage, inner: str, expected: str | None = None) -> bytes:
        """One file of an npm package; ``expected`` is its sha256.

        Raises:
            ValueError: the package or the file is not the one that was asked for.
        """
        archive = (
            self.folder / f"{package.name.lstrip('@').replace('/', '-')}-{package.version}.tgz"
        )
        if not archive.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            what = f"{package.name}@{package.version}"
            subprocess.run(
                ["npm", "pack", "--silent", "--pack-destination", str(self.folder), what],
                check=True,
            )
        got = "sha512-" + base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
        if got != package.integrity:
            raise ValueError(f"{archive.name} has integrity {got}, expected {package.integrity}")
        with tarfile.open(archive) as tar:
            member = tar.extractfile(inner)
            if member is None:
                raise ValueError(f"{archive.name} holds no file {inner}")
            data = member.read()
        if expected is not None and sha256(data) != expected:
            raise ValueError(
                f"{inner} of {archive.name} has sha256 {sha256(data)}, expected {expected}"
            )
        return data

    def github_file(self, source: GithubFile) -> bytes:
        """One file of a GitHub repository.

        Raises:
            ValueError: the file is not the one that was asked for.
        """
        kept = (
            self.folder
            / f"{source.repository.replace('/', '-')}-{source.commit}-{Path(source.path).name}"
        )
        if not kept.exists():
            clone = self.folder / f"{source.repository.replace('/', '-')}.git"
            if not clone.exists():
                url = f"https://github.com/{source.repository}"
                subprocess.run(
                    ["git", "clone", "--quiet", "--bare", "--filter=blob:none", url, str(clone)],
                    check=True,
                )
            show = ["git", "-C", str(clone), "show", f"{source.commit}:{source.path}"]
            kept.write_bytes(subprocess.run(show, check=True, capture_output=True).stdout)
        data = kept.read_bytes()
        if sha256(data) != source.sha256:
            raise ValueError(f"{kept.name} has sha256 {sha256(data)}, expected {source.sha256}")
        return data

    def pypi_folder(self, source: PypiSource) -> Path:
        """Folder of an unpacked source distribution.

        Raises:
            ValueError: the archive is not the one that was asked for.
        """
        archive = self.folder / f"{source.name.replace('-', '_')}-{source.version}.tar.gz"
        if not archive.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            options = [
                "--quiet",
                "--no-deps",
                "--no-binary",
                ":all:",
                "--no-build-isolation",
                "--dest",
            ]
            what = f"{source.name}=={source.version}"
            subprocess.run(
                [sys.executable, "-m", "pip", "download", *options, str(self.folder), what],
                check=True,
            )
        if sha256(archive.read_bytes()) != source.sha256:
            raise ValueError(
                f"{archive.name} has sha256 {sha256(archive.read_bytes())}, expected "
                f"{source.sha256}"
            )
        folder = archive.with_name(archive.name.removesuffix(".tar.gz"))
        if not folder.is_dir():
            with tarfile.open(archive) as tar:
                tar.extractall(self.folder, filter="data")
        return folder
