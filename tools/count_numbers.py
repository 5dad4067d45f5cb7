"""Count the numbers that decide results in Python files: settings, constants and literals, and fitted coefficients.

    python tools/count_numbers.py physic_core/engine physic_core/pipeline/engine_input.py [--list]

A number counts once, where it is written:

- setting: a number in the default of an annotated field of a class, and every such field whose default is a number;
- constant: a number in an assignment at the top of a module or class;
- literal: any other number in code;
- coefficient: a number in a data file (JSON, TOML, CSV) of the given folders.

0, 1, 2 and .5 are arithmetic and do not count, unless one is the value of a setting or of a constant.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ARITHMETIC = (0, 1, 2, 0.5)
KINDS = ("setting", "constant", "literal", "coefficient")


def main() -> int:
    """Print the counts by kind, and with --list every number with its place."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("paths", nargs="+", type=Path, help="folders and files")
    parser.add_argument("--list", action="store_true", help="print every number with its place")
    given = parser.parse_args()
    counts: Counter[str] = Counter()
    lines = 0
    for path in sorted({file for top in given.paths for file in files_of(top)}):
        if path.suffix == ".py":
            text = path.read_text(encoding="utf-8")
            lines += text.count("\n")
            found = list(numbers_of_source(text))
        else:
            found = [(0, "coefficient", value) for value in numbers_of_data(path)]
        counts.update(kind for _, kind, _ in found)
        if given.list:
            print("".join(f"{path}:{line}: {kind} {value}\n" for line, kind, value in found), end="")
    print("; ".join(f"{kind}s {counts[kind]}" for kind in KINDS) + f"; all {counts.total()}; lines of Python {lines}")
    return 0


def files_of(top: Path) -> list[Path]:
    """Return a file itself, or the Python and data files of a folder."""
    if top.is_file():
        return [top]
    return [path for path in top.rglob("*") if path.suffix in (".py", ".json", ".toml", ".csv")]


def numbers_of_source(text: str) -> Iterator[tuple[int, str, float]]:
    """Yield line, kind and value of every number that counts in Python source."""
    tree = ast.parse(text)
    for node in tree.body:
        yield from _numbers_of_statement(node)


def _numbers_of_statement(node: ast.stmt) -> Iterator[tuple[int, str, float]]:
    """Yield the numbers of a statement of a module or class."""
    if isinstance(node, ast.ClassDef):
        for inner in node.body:
            is_field = isinstance(inner, ast.AnnAssign) and "ClassVar" not in ast.unparse(inner.annotation)
            if is_field and isinstance(inner, ast.AnnAssign) and inner.value is not None:
                yield from _numbers(inner.value, "setting", direct=True)
            else:
                yield from _numbers_of_statement(inner)
    elif isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
        yield from _numbers(node.value, "constant", direct=True)
    else:
        yield from _numbers(node, "literal")


def _numbers(node: ast.AST, kind: str, *, direct: bool = False) -> Iterator[tuple[int, str, float]]:
    """Yield the numbers below a node; ``direct``: a number that is the node itself counts whatever its value."""
    value = node.operand if isinstance(node, ast.UnaryOp) else node
    if direct and isinstance(value, ast.Constant) and _is_number(value.value):
        yield value.lineno, kind, value.value
        return
    for inner in ast.walk(node):
        if isinstance(inner, ast.Constant) and _is_number(inner.value) and inner.value not in ARITHMETIC:
            yield inner.lineno, kind, inner.value


def _is_number(value: object) -> bool:
    """Return whether a constant is a number and no truth value."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def numbers_of_data(path: Path) -> list[float]:
    """Return all numbers of a JSON, TOML or CSV file."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".csv":
        return [float(cell) for cell in re.split(r"[,\s]+", text) if re.fullmatch(r"[-+]?\d*\.?\d+(e[-+]?\d+)?", cell)]
    return list(_leaves(json.loads(text) if path.suffix == ".json" else tomllib.loads(text)))


def _leaves(value: Any) -> Iterator[float]:
    """Yield the numbers of nested lists and mappings."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for inner in value:
            yield from _leaves(inner)
    elif _is_number(value):
        yield value


if __name__ == "__main__":
    sys.exit(main())
