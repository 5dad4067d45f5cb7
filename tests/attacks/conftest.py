from __future__ import annotations

import sys
from pathlib import Path

# The package ``fuzzing`` beside this file, which ``fuzz.py`` uses too.
sys.path.insert(0, str(Path(__file__).parent))
