"""Check the English of the pages and messages that users read.

    python tools/prose.py            # or: make lint

Text is Markdown without code, and the strings of five words and more in the code of core and
plugins. proselint checks it by ``tools/prose.json``, and so does the list of words there that
newcomers stumble over.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "tools" / "prose.json"
CODE = ("physic_core", "plugins", "contrib")
FEWEST_WORDS = 5
_NO_PROSE = re.compile(r"^(```|~~~).*?^\1|<!--.*?-->", re.M | re.S)


def page_lines(file: Path) -> Iterator[tuple[int, str]]:
    """Yield number and text of each line of a page that has prose."""
    text = file.read_text(encoding="utf-8")
    blank = _NO_PROSE.sub(lambda found: re.sub(r"[^\n]", "", found[0]), text)
    for number, line in enumerate(blank.splitlines(), 1):
        line = re.sub(r"`[^`]*`", lambda code: f"v{code.start()}", line)
        line = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", line)
        line = re.sub(r"\s*\|\s*", "; ", line)
        line = re.sub(r"[*#>]|<[^>]+>|https?://\S+", " ", line).strip("; ")
        if line.strip("-: "):
            yield number, line


def messages(file: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of each sentence in the strings of a file; of docstrings, only those that
    are the help of a command.
    """
    tree = ast.parse(file.read_text(encoding="utf-8"))
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant | ast.JoinedStr):
            continue
        parent = parents.get(node)
        if isinstance(parent, ast.JoinedStr | ast.FormattedValue):
            continue
        if isinstance(parent, ast.Expr) and not is_command(parents[parent]):
            continue
        text = string_of(node)
        if len(re.findall(r"[a-z]{2,}", text)) >= FEWEST_WORDS and " " in text.strip():
            yield node.lineno, " ".join(text.split())


def is_command(node: ast.AST) -> bool:
    """Return whether a function is a command of click, whose docstring is its help."""
    decorators = getattr(node, "decorator_list", [])
    return any(re.search(r"\b(command|group)\b", ast.unparse(one)) for one in decorators)


def string_of(node: ast.Constant | ast.JoinedStr) -> str:
    """Return a string with a name in place of each value that is filled in."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    return "".join(
        str(part.value) if isinstance(part, ast.Constant) else f"value{index}"
        for index, part in enumerate(node.values)
    )


def sources() -> dict[str, list[tuple[int, str]]]:
    """Return the lines with prose of each page and of each file of code."""
    listed = subprocess.run(
        ["git", "ls-files", "*.md", *(f"{folder}/**/*.py" for folder in CODE)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    lines_of = {}
    for name in listed.stdout.split():
        if "/tests/" in name or "/scaffold/" in name or "NOTICE" in name:
            continue
        read = page_lines if name.endswith(".md") else messages
        if lines := list(read(ROOT / name)):
            lines_of[name] = lines
    return lines_of


def stumbling(sources: dict[str, list[tuple[int, str]]], words: dict[str, str]) -> list[str]:
    """Return a line for each use of a word that newcomers stumble over."""
    return [
        f"{name}:{number}: {match[0]!r}: {words[word]}"
        for name, lines in sources.items()
        for number, text in lines
        for word in words
        if (match := re.search(rf"\b(?:{word})\b", text, re.I))
    ]


def linted(sources: dict[str, list[tuple[int, str]]], config: dict[str, Any]) -> list[str]:
    """Return what proselint finds, without accepted words."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        settings = folder / "proselintrc.json"
        settings.write_text(json.dumps(config["proselint"]))
        names = {}
        for index, (name, lines) in enumerate(sources.items()):
            file = folder / f"{index}.txt"
            ends = (text if text[-1] in ".:!?" else f"{text}." for _, text in lines)
            file.write_text("\n\n".join(ends) + "\n", encoding="utf-8")
            names[str(file)] = name, lines
        command = ["proselint", "--config", str(settings), "-o", "compact", "check", *names]
        program = Path(sys.executable).with_name(command[0])
        done = subprocess.run([str(program), *command[1:]], capture_output=True, text=True)
    findings = []
    for row in done.stdout.splitlines():
        if match := re.match(r"(\S+?\.txt):(\d+):\d+: (.*)", row):
            name, lines = names[match[1]]
            number = lines[min((int(match[2]) - 1) // 2, len(lines) - 1)][0]
            ignored = match[3].startswith(tuple(config["ignored"]))
            if not ignored and not any(word in match[3] for word in config["accepted"]):
                findings.append(f"{name}:{number}: {match[3]}")
    return findings if done.returncode < 2 else [done.stderr]


def main() -> int:
    """Check."""
    text = sources()
    config = json.loads(CONFIG.read_text(encoding="utf-8"))
    findings = stumbling(text, config["avoid"]) + linted(text, config)
    print("\n".join(findings) or "the prose linter finds nothing")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
