"""Results of backends that the interface allows and the photo contradicts: the backend is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import reconstruct
from physic_mock import backends

pytestmark = pytest.mark.usefixtures("few_steps")


def mistaken(kind, field, change):
    """A class like a mock, one field of whose results is changed."""

    class Mistaken(kind):
        def infer(self, *arguments):
            found = super().infer(*arguments)
            return replace(found, **{field: np.float32(change(getattr(found, field)))})

    return {kind.interface: Mistaken}


DEPTH = backends.MockMetricDepth, "depth"
CONTACT = backends.MockContactPrior, "probability"


@pytest.mark.parametrize(
    ("wrong", "words", "check"),
    [
        (mistaken(*DEPTH, lambda z: 1000 * z), "is its unit millimetres", "depth_scale"),
        (mistaken(*DEPTH, lambda z: z[:, ::-1]), "mirrored", "depth_order"),
        (mistaken(*CONTACT, lambda p: 1 - p), "are they inverted", None),
        (mistaken(*CONTACT, np.zeros_like), "0 everywhere", None),
    ],
)
def test_a_plausible_mistake_is_a_warning_that_names_the_backend(world, wrong, words, check):
    found = reconstruct(world.image, "mock", backends=wrong)
    (interface,) = wrong
    (warning,) = (text for text in found.warnings if words in text)
    assert f"{interface} '" in warning
    assert [one.name for one in found.checks if one.failed and one.person is None] == (
        [check] if check else []
    )
    assert check is None or found.grade != "good"
