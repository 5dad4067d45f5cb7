"""The imports of a file."""

from __future__ import annotations

import ast


def imported_names(file):
    """Yield module and name, "" without one, of each import of a file, in functions and for types,
    too.
    """
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield from ((str(node.module), alias.name) for alias in node.names)
