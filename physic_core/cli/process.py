"""The process of the command ``physic``, and its end."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from contextlib import suppress

GC_THRESHOLD = 100_000
"""Garbage-collection threshold, new objects; the default of 700 costs .35 s in the imports for a
photo, whose objects all stay alive.
"""


def main_of_process() -> None:
    """Run the command, and end the process without interpreter teardown, which takes 0.7 s with
    torch.

    Everything registered with ``atexit`` is run, such as the deletion of temporary folders, and
    threads are joined.
    """
    _open_closed_streams()
    from physic_core.cli import main

    gc.set_threshold(GC_THRESHOLD)
    code = 1
    # Registered before any other function, and so called after all of them.
    atexit.register(lambda: _exit_process(code))
    try:
        main(prog_name="physic")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
        raise


def _open_closed_streams() -> None:
    """Open standard streams that the caller has closed, as daemons do: a file would get their
    number, and with it what libraries print.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest free number, which is this one
            stream = open(number, mode, encoding="utf-8", closefd=False)  # noqa: SIM115 -- until the end
            setattr(sys, name, stream)


def _exit_process(code: int) -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # the reader is gone, or the stream is closed
            stream.flush()
    os._exit(code)
