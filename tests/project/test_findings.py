"""Findings have one form."""

import re
import runpy
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "findings"
SCRIPTS = {path.stem: path.read_text() for path in FOLDER.glob("*.sh") if path.stem != "common"}
READER = "(right|in part|wrong)"
FORM = re.compile(
    r"#!/bin/sh\n(# .+\n)+# Guessed: .+\n(# .+\n)*# Measured on \d{4}-\d\d-\d\d.+\n"
    rf"(# (?!Readers).+\n)*(# Readers guessed: {READER}, {READER}, {READER}\.\n)?"
    r'\. "\$\(dirname "\$0"\)/common\.sh"\n'
)


def test_headers_state_question_guess_and_date():
    assert [name for name, text in SCRIPTS.items() if not FORM.match(text)] == []


def test_the_table_names_the_tools_of_each_finding():
    tools = runpy.run_path(str(FOLDER / "table.py"))["tools"]
    assert [name for name, text in SCRIPTS.items() if not re.search(r"\w \d", tools(text))] == []
    assert tools(SCRIPTS["three-usd-guides"]) == "three 0.187.0"
