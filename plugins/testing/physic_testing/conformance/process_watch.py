"""Record of what calls of a backend change in the process and ask of the network: settings, files,
printed text and addresses.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO

from physic_core.discovery.process_state import restored_process_state
from physic_testing.conformance.leaks import changed_settings, read_settings
from physic_testing.conformance.network_and_memory import no_network


class Watch:
    """Record of what the watched calls changed in the process.

    Attributes:
        changed: names of settings of the process.
        files: names that appeared in the current folder.
        printed: text that was written to the standard output.
        places: network addresses that were requested, without success.
    """

    def __init__(self) -> None:
        self.changed: set[str] = set()
        self.files: set[str] = set()
        self.printed = ""
        self.places: list[str] = []

    @contextmanager
    def load(self) -> Iterator[None]:
        """Watch a call of ``load``, with another number of torch's threads: an earlier load may
        have set its own.
        """
        torch = sys.modules.get("torch")
        threads = 0 if torch is None else torch.get_num_threads()
        if torch is not None:
            torch.set_num_threads(threads + 1)
        try:
            with self._settings(is_load=True):
                yield
        finally:
            if torch is not None:
                torch.set_num_threads(threads)

    @contextmanager
    def call(self) -> Iterator[None]:
        """Watch a call of ``infer``."""
        names = set(os.listdir())
        output = StringIO()
        try:
            with redirect_stdout(output), self._settings(is_load=False):
                yield
        finally:
            self.printed += output.getvalue()
            self.files |= set(os.listdir()) - names

    @contextmanager
    def _settings(self, *, is_load: bool) -> Iterator[None]:
        """Watch the settings of the process; those that the pipeline restores are restored."""
        before = read_settings()
        with restored_process_state(), no_network() as places:
            try:
                yield
            finally:
                self.changed |= changed_settings(before, is_load=is_load)
                self.places += places
