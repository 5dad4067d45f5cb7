"""Look up known vulnerabilities of the pinned dependencies, and fail unless every one was looked up.

    python tools/audit.py [constraints.txt]

It exits with 1 if a vulnerability is known, and with 2 if pip-audit or the network is missing or packages are unknown
to it: a package that was not looked up does not pass.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

VULNERABLE, NOT_DONE = 1, 2


def report(found: Mapping[str, Any]) -> tuple[int, str]:
    """Return the exit code and the text for an answer of pip-audit."""
    packages = found["dependencies"]
    lines = [
        f"{package['name']} {package['version']}: {hole['id']}, fixed in {' or '.join(hole['fix_versions']) or 'none'}"
        for package in packages
        for hole in package.get("vulns", ())
    ]
    skipped = [package["name"] for package in packages if "skip_reason" in package]
    if lines:
        return VULNERABLE, "\n".join(lines)
    if skipped or not packages:
        return (
            NOT_DONE,
            f"no audit: {len(skipped)} of {len(packages)} packages were not found: {', '.join(skipped[:5])}",
        )
    return 0, f"no known vulnerabilities in {len(packages)} packages"


def main() -> int:
    """Run pip-audit on a file of pinned versions."""
    file = Path(sys.argv[1] if len(sys.argv) > 1 else "constraints.txt")
    program = shutil.which("pip-audit", path=str(Path(sys.executable).parent)) or shutil.which("pip-audit")
    if program is None:
        print("no audit: pip-audit is not installed: pip install pip-audit", file=sys.stderr)
        return NOT_DONE
    command = [program, "-r", str(file), "--no-deps", "--disable-pip", "--progress-spinner", "off", "-f", "json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        code, text = report(json.loads(done.stdout))
    except ValueError:
        reason = (done.stderr.strip().splitlines() or ["no output"])[-1]
        code, text = NOT_DONE, f"no audit: pip-audit failed, is there a network? ({reason})"
    print(text, file=sys.stderr if code else sys.stdout)
    return code


if __name__ == "__main__":
    sys.exit(main())
