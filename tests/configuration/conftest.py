from __future__ import annotations

import sys
from pathlib import Path

# ``extremes``, which finds the bounds of all settings.
sys.path.insert(0, str(Path(__file__).parents[2] / "tools" / "attacks"))
