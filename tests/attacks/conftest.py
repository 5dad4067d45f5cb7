from __future__ import annotations

import sys
from pathlib import Path

# ``hostile`` beside this file, which worker processes import, and the modules of the tool.
sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "tools" / "attacks")]
