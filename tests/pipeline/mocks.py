"""Mocks whose answers are changed."""

from __future__ import annotations

import numpy as np

from physic_core import load_config, reconstruct
from physic_core.types.arrays import select_people


def run(image, *settings, **given):
    """The result of the mocks with these settings, and what is given to ``reconstruct``."""
    return reconstruct(image, load_config(preset="mock", overrides=list(settings)), **given)


def changed(kind, change):
    """The argument ``backends`` of a run in which a mock answers ``change(answer, *arguments)``."""

    def infer(self, *arguments):
        return change(kind.infer(self, *arguments), *arguments)

    return {kind.interface: type("Changed", (kind,), {"infer": infer})}


def without_people(people, *_):
    """A change to no people."""
    return select_people(people, np.zeros(len(people), bool))
