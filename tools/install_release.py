"""Install PhySIC from this archive into a folder of its own.

    python3 physic-VERSION.zip [FOLDER] [OPTION OF PIP ...]

FOLDER is "physic" by default, and becomes a virtual environment. Only the standard library is used.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ARCHIVE = Path(__file__).parent  # Python runs an archive as a folder


def extract(target: Path) -> None:
    """Extract the archive, and compare each file with its SHA-256."""
    with zipfile.ZipFile(ARCHIVE) as archive:
        archive.extractall(target)
    for line in (target / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split("  ", 1)
        if hashlib.sha256((target / name).read_bytes()).hexdigest() != digest:
            sys.exit(f"{ARCHIVE} is damaged: {name} has another SHA-256; copy it again")


def main(arguments: list[str]) -> None:
    """Install into the folder that the arguments name."""
    if sys.version_info < (3, 11):  # noqa: UP036 - whatever Python runs the archive
        sys.exit(f"PhySIC needs Python 3.11 or newer, this is {sys.version.split()[0]}")
    named = bool(arguments) and not arguments[0].startswith("-")
    folder = Path(arguments[0] if named else "physic")
    if folder.exists():
        sys.exit(f"{folder} exists: name another folder, or remove it")
    with tempfile.TemporaryDirectory() as temporary:
        content = Path(temporary)
        extract(content)
        try:
            venv.create(folder, with_pip=True)
            bin_folder = folder / ("Scripts" if os.name == "nt" else "bin")
            wheels = sorted(map(str, (content / "wheels").glob("*.whl")))
            pip = [str(bin_folder / "python"), "-m", "pip", "install", "-q"]
            pip += ["--disable-pip-version-check", "-c", str(content / "constraints.txt")]
            subprocess.run([*pip, *arguments[named:], *wheels], check=True)
        except (subprocess.CalledProcessError, OSError) as error:
            shutil.rmtree(folder, ignore_errors=True)
            sys.exit(f"nothing was installed: {error}")
        documents = folder / "share" / "physic"
        shutil.copytree(content / "licenses", documents / "licenses")
        for name in ("CHANGELOG.md", "CITATION.cff", "sbom.json"):
            shutil.copy(content / name, documents)
    print(f"installed; now run:\n\n    {bin_folder / 'physic'} run photo.jpg")


if __name__ == "__main__":
    main(sys.argv[1:])
