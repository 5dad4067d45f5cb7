from __future__ import annotations

import sys
from pathlib import Path

# right_backends.py and wrong_backends.py, which the tests of this folder share.
sys.path.append(str(Path(__file__).parent))
