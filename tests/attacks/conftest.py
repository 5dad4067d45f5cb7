from __future__ import annotations

import sys
from pathlib import Path

# The modules beside this file; worker processes import ``hostile``.
sys.path.insert(0, str(Path(__file__).parent))
