"""The page of notes has each note and warning of a result that the code can print, and no other."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "notes.md"
CORE = ("cache", "engine", "io", "judge", "pipeline", "prepare")
PLUGINS = ("embedded", "human", "onnx", "opencv", "scene", "transformers")
SINKS = {"advice", "doubt", "guess", "note", "notes", "otherwise", "problem", "warn", "warning"}
SINKS |= {"doubts", "warnings", "why"}
SHORTEST = 40  # characters; shorter ones are parts of sentences
PARTS = {
    "EXIF: … mm (35 mm equivalent, by the diagonal)",
    "default (field of view … degrees along the long side)",
    "Of a child give …, of a small person --stature METRES in the same order; leave out a figure "
    "or picture by --ignore x,y",
    "since the plane of the floor is not found",
}


def name_of(node):
    return getattr(node, "id", getattr(node, "attr", ""))


class Texts:
    """Texts that reach a sink, with "…" for what is filled in: through names of the same function,
    and what functions return.
    """

    def __init__(self, paths):
        trees = [ast.parse(path.read_text(encoding="utf-8")) for path in paths]
        self.found = set()
        self.seen = set()
        self.functions = {}
        functions = self.nodes(trees, ast.FunctionDef)
        for function in functions:
            self.functions.setdefault(function.name, []).append(function)
        for function in functions:
            told = [value for node in ast.walk(function) for value in self.told(node)]
            decorators = [name_of(getattr(one, "func", one)) for one in function.decorator_list]
            if "_check" in decorators or function.name.startswith("doubt"):
                told += self.answers(function)
            for value in told:
                self.take(value, function)

    @staticmethod
    def nodes(trees, kind):
        return [node for tree in trees for node in ast.walk(tree) if isinstance(node, kind)]

    def answers(self, function):
        found = self.nodes([function], (ast.Return, ast.Yield, ast.YieldFrom))
        return [one.value for one in found if one.value is not None]

    @staticmethod
    def told(node):
        """What a statement or a call gives to a sink."""
        if isinstance(node, ast.Assign | ast.AugAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            return [node.value] if SINKS & set(map(name_of, targets)) else []
        if not isinstance(node, ast.Call):
            return []
        names = set(map(name_of, ast.walk(node.func)))
        own = name_of(node.func)
        is_sink = own in ("note", "warn", "skipped") or (own == "append" and names & SINKS)
        keywords = [one.value for one in node.keywords if one.arg in SINKS]
        texts = node.args[3:] if own == "_check" else node.args if is_sink else ()
        return [*texts, *keywords]

    def take(self, node, function):
        if id(node) in self.seen:
            return
        self.seen.add(id(node))
        if isinstance(node, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
            self.found.add("".join(parts))
        elif isinstance(node, ast.Constant):
            self.found |= {node.value} if isinstance(node.value, str) else set()
        elif isinstance(node, ast.Name):
            for one in self.nodes([function], ast.Assign):
                if any(node.id in map(name_of, ast.walk(target)) for target in one.targets):
                    self.take(one.value, function)
        elif isinstance(node, ast.Call):
            called = self.functions.get(name_of(node.func), ())
            for one in called:
                for answer in self.answers(one):
                    self.take(answer, one)
            for argument in () if called else node.args:
                self.take(argument, function)
        elif not isinstance(node, ast.Compare | ast.Attribute):
            for child in ast.iter_child_nodes(node):
                self.take(child, function)


@cache
def texts():
    folders = [ROOT / "physic_core" / name for name in CORE]
    folders += [next(ROOT.glob(f"plugins/*/physic_{name}")) for name in PLUGINS]
    return Texts(sorted(path for folder in folders for path in folder.rglob("*.py"))).found


@cache
def phrases():
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:3] == "| `"]
    return [phrase for row in rows for phrase in re.findall(r"`([^`]+)`", row.split("|")[1])]


def test_each_sentence_is_on_the_page():
    missing = [
        text
        for text in texts()
        if len(text) >= SHORTEST
        and text not in PARTS
        and not any(phrase in text for phrase in phrases())
    ]
    assert sorted(missing) == []


def test_each_phrase_of_the_page_is_printed():
    assert [phrase for phrase in phrases() if not any(phrase in text for text in texts())] == []
