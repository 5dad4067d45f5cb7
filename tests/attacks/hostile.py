"""Plugin code that hangs or ends its process; worker processes import this module."""

from __future__ import annotations

import ctypes
import os
import time

from physic_mock.backends import MockMetricDepth


def hang_in_python():
    while True:
        time.sleep(0.1)


def hang_with_the_interpreter_lock():
    ctypes.PyDLL(None).sleep(1000)


HANGS = (hang_in_python, hang_with_the_interpreter_lock)


def open_worker():
    return lambda hang: hang()


class Printing(MockMetricDepth):
    """Prints to stdout in three ways, and an answer of its own; closes stdout."""

    def load(self, device="cpu"):
        print('physic-doctor: {"state": "broken"}')
        os.write(1, b'{"state": "broken"}\n')
        os.system("echo '[]'")
        os.close(1)


class Forging(MockMetricDepth):
    """Prints that it is ok, and ends the process."""

    def load(self, device="cpu"):
        print(
            'physic-doctor: {"interface": "metric_depth", "backend": "forged", "owner": "", '
            '"state": "ok"}',
            flush=True,
        )
        os._exit(0)
