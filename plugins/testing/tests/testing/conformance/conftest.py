from __future__ import annotations

import sys
from pathlib import Path

# stand_ins.py, faults.py and wrong_backends.py, which the tests of this folder share.
sys.path.append(str(Path(__file__).parent))
