"""Backends that say something wrong of themselves before they are loaded: for each check of that, wrong ones."""

from __future__ import annotations

import itertools
import socket
import time

from right_backends import RightMetricDepth
from wrong_backends import wrong

MISSING, FINGERPRINT = "missing_is_fast_and_repeatable", "fingerprint_works_before_load"
COUNT = itertools.count()


def work() -> None:
    """As reading weights would take."""
    end = time.process_time() + 0.3
    while time.process_time() < end:
        pass


@wrong("what is missing told by a number", "loads_or_reports_what_is_missing")
class Counting(RightMetricDepth):
    def missing(self):
        return 0


@wrong("what is missing told by reading it", MISSING)
class Reading(RightMetricDepth):
    def missing(self):
        work()
        return ()


@wrong("what is missing told once", MISSING)
class Once(RightMetricDepth):
    told = False

    def missing(self):
        lacking = () if self.told else ("no file weights.onnx: fetch it from https://example.org",)
        self.told = True
        return lacking


@wrong("a fingerprint by reading all weights", FINGERPRINT)
class Hashing(RightMetricDepth):
    def fingerprint(self):
        work()
        return "e3b0c442"


@wrong("another fingerprint each time", FINGERPRINT)
class Restless(RightMetricDepth):
    def fingerprint(self):
        return str(next(COUNT))


@wrong("a fingerprint of the object's own", FINGERPRINT)
class Own(RightMetricDepth):
    def __init__(self, options=None):
        super().__init__(options)
        self.number = next(COUNT)

    def fingerprint(self):
        return f"weights {self.number}"


@wrong("a fingerprint of bytes", FINGERPRINT)
class Bytes(RightMetricDepth):
    def fingerprint(self):
        return b"e3b0c442"


@wrong("a fingerprint of what load read", FINGERPRINT)
class Loaded(RightMetricDepth):
    weights: bytes | None = None

    def load(self, device="cpu"):
        super().load(device)
        self.weights = b"weights"

    def fingerprint(self):
        return self.weights.hex()


@wrong("a fingerprint from the network", FINGERPRINT)
class Asking(RightMetricDepth):
    def fingerprint(self):
        try:
            socket.create_connection(("weights.example", 443))
        except OSError:
            return "unknown"
        return "latest"
