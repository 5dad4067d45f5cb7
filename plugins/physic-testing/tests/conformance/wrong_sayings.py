"""Backends that say something wrong of themselves before they are loaded: for each check of that,
wrong ones.
"""

from __future__ import annotations

import time

from right_backends import RightMetricDepth
from wrong_backends import wrong

MISSING = "missing_is_fast_and_repeatable"
FINGERPRINT = "fingerprint_works_before_load"


def work() -> None:
    """As reading weights would take."""
    end = time.process_time() + 0.3
    while time.process_time() < end:
        pass


@wrong("what is missing, found by reading it", MISSING)
class Reading(RightMetricDepth):
    def missing(self):
        work()
        return ()


@wrong("a fingerprint by reading all weights", FINGERPRINT)
class Hashing(RightMetricDepth):
    def fingerprint(self):
        work()
        return "e3b0c442"
