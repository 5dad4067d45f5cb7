"""Write one archive that installs PhySIC without git, make or an index of its own distributions.

    python tools/release.py [FOLDER]

FOLDER/physic-VERSION.zip has the wheels of ``requirements.txt``, the versions that were tested
together, the bill of materials, licenses and notices, changelog, citation, and the SHA-256 of each
file. Python runs it: ``tools/install_release.py`` is its ``__main__.py``.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

from hatchling.builders.wheel import WheelBuilder
from sbom import bill

ROOT = Path(__file__).parents[1]
DOCUMENTS = ("CHANGELOG.md", "CITATION.cff", "constraints.txt")
_CHANGED = (1980, 1, 1, 0, 0, 0)  # of every entry, so that equal content is an equal archive


def folders() -> list[Path]:
    """Return the folders of the distributions that ``requirements.txt`` installs."""
    lines = (ROOT / "requirements.txt").read_text(encoding="utf-8").splitlines()
    return [ROOT / line.removeprefix("-e ") for line in lines if line.startswith("-e ")]


def notices() -> Iterator[tuple[str, bytes]]:
    """Yield name and content of the licence, and of the notice of each network and body."""
    for name in ("LICENSE", "NOTICE"):
        yield f"licenses/{name}", (ROOT / name).read_bytes()
    for folder in folders():
        packages = folder.glob("physic_*")
        for file in sorted(one for package in packages for one in package.rglob("*NOTICE*")):
            yield f"licenses/{file.relative_to(ROOT).as_posix()}", file.read_bytes()


def write_archive(folder: Path) -> Path:
    """Write the archive into a folder, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    entries = {
        **{name: (ROOT / name).read_bytes() for name in DOCUMENTS},
        "sbom.json": (json.dumps(bill(), indent=2) + "\n").encode(),
        **dict(notices()),
    }
    with tempfile.TemporaryDirectory() as temporary:
        for project in folders():
            wheel = Path(next(WheelBuilder(str(project)).build(directory=temporary)))
            entries[f"wheels/{wheel.name}"] = wheel.read_bytes()
    sums = (f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in entries.items())
    entries["SHA256SUMS"] = "".join(sums).encode()
    entries["__main__.py"] = (ROOT / "tools" / "install_release.py").read_bytes()
    core = next(name for name in entries if name.startswith("wheels/metricbody-"))
    version = re.split("-", core)[1]
    path = folder / f"physic-{version}.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in entries.items():
            kind = zipfile.ZIP_STORED if name.endswith(".whl") else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(name, _CHANGED), content, kind)
    return path


if __name__ == "__main__":
    made = write_archive(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "dist")
    print(f"{hashlib.sha256(made.read_bytes()).hexdigest()}  {made}")
