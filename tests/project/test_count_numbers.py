"""The counter of numbers counts each number once, by what it is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

TOOL = Path(__file__).parents[2] / "tools" / "count_numbers.py"

SOURCE = '''"""Text with 77 and 78."""
LIMIT_M = 0.15
ONE = 1
SIZES = (3, 4, 1)


class Settings:
    """Settings."""

    name: str = "seven 7"
    weight: float = 2.0
    shares: tuple[float, ...] = (0.3, 1.0)


def scaled(x: float, power: float = 3) -> float:
    """Return x, 9 times."""
    return 9 * x**2 + 0.5 - True
'''


def test_settings_constants_literals_and_coefficients_are_counted_once(tmp_path: Path) -> None:
    (tmp_path / "code.py").write_text(SOURCE)
    (tmp_path / "fit.json").write_text('{"weights": [0.5, -1, 2.5], "name": "x"}')
    done = subprocess.run([sys.executable, TOOL, tmp_path], capture_output=True, text=True, check=True)
    lines = SOURCE.count("\n")
    assert done.stdout == f"settings 2; constants 4; literals 2; coefficients 3; all 11; lines of Python {lines}\n"
