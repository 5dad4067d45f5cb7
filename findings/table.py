"""Run findings, one after another, and print a table of what changed.

python3 findings/table.py [NAME ...]    # without names, all
"""

import re
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
STATES = {0: "as before", 3: "not measured"}


def tools(text: str) -> str:
    """Pinned packages that the header names, with versions."""
    header = " ".join(line for line in text.splitlines() if line.startswith("#")).lower()
    installed = " ".join(re.findall(r"^ *install(?:\\\n|.)*", text, re.MULTILINE))
    pins = re.findall(r"(@?[\w./-]+)(?:\[\w+\])?(?:==|@)(\d[\w.]*)", installed)
    named = [
        (name, version) for name, version in pins if re.split(r"[-_.]", name.lower())[0] in header
    ]
    return ", ".join(f"{name} {version}" for name, version in named or pins)


def row(path: Path) -> tuple[int, str]:
    """Run a finding. Return its exit status, and its row."""
    text = path.read_text()
    named = tools(text)
    date = re.search(r"^# Measured on ([\d-]+)", text, re.MULTILINE)
    readers = re.search(r"^# Readers guessed: (.+)\.", text, re.MULTILINE)
    run = subprocess.run(["sh", path], capture_output=True, text=True, check=False)
    versions = [tool.rsplit(" ", 1)[-1] for tool in named.split(", ")]
    seen = run.stdout.strip().splitlines()
    while seen and not any(version in seen[0] for version in versions):
        del seen[0]
    seen = seen or (run.stderr or run.stdout).strip().splitlines()[-1:]
    state = STATES.get(run.returncode, "changed")
    stated = [found[1] if found else "" for found in (date, readers)]
    cells = [path.stem, named, *stated, state, " ".join(seen).replace("|", "/")]
    return run.returncode, "| " + " | ".join(cells) + " |"


def main() -> None:
    names = sys.argv[1:]
    scripts = [path for path in sorted(FOLDER.glob("*.sh")) if path.name != "common.sh"]
    known = {path.stem for path in scripts}
    if unknown := set(names) - known:
        sys.exit(f"no finding of this name: {', '.join(sorted(unknown))}; see {FOLDER}")
    print("| finding | tools | measured on | readers guessed | now | seen now |")
    print("|---|---|---|---|---|---|")
    codes = []
    for path in scripts:
        if not names or path.stem in names:
            code, line = row(path)
            codes.append(code)
            print(line, flush=True)
    changed = sum(code not in STATES for code in codes)
    print(f"\n{codes.count(0)} as before, {changed} changed, {codes.count(3)} not measured")
    sys.exit(1 if changed or codes.count(3) else 0)


if __name__ == "__main__":
    main()
