"""The core looks at the photo before it calls a backend, so that no backend has to."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.configuration.resolve import ResolvedBackend
from physic_core.errors import InputError
from physic_core.interfaces import Inpainter, InpainterRequest
from physic_core.interfaces.backend import call
from physic_core.pipeline.stage_caller import StageCaller
from physic_core.types import Provenance

PHOTO = np.full((6, 8, 3), 7, np.uint8)
MASK = np.zeros((6, 8), bool)
WANTED = "the image must be a numpy array (H, W, 3) of uint8 RGB, got "
STRANGE = [
    (PHOTO / np.float32(255), "(6, 8, 3) float32: convert it before the call"),
    (PHOTO[..., 0], "(6, 8) uint8: convert it before the call"),
    (PHOTO.transpose(2, 0, 1), "(3, 6, 8) uint8: convert it before the call"),
    (PHOTO[:0], "(0, 8, 3) uint8: convert it before the call"),
    (PHOTO.tolist(), "list"),
    (torch.from_numpy(PHOTO), "Tensor: write .detach().cpu().numpy()"),
]


class Untouched(Inpainter):
    """Fails if it is loaded or called."""

    def load(self, device="cpu"):
        raise AssertionError

    def infer(self, image, mask):
        raise AssertionError


@pytest.mark.parametrize(("image", "got"), STRANGE, ids=[got for _, got in STRANGE])
def test_an_upload_that_is_no_photo_reaches_no_backend(image, got):
    request = InpainterRequest(image, MASK)
    who = ResolvedBackend(
        Untouched(), Provenance("inpainter", "mine", "my_plugin", "my-dist", "1.0", {}, "")
    )
    stages = StageCaller("cpu", 1)
    with pytest.raises(InputError) as alone:
        call(who.backend, request)
    with pytest.raises(InputError) as in_run:
        stages.call_backend("inpainting", who, request)
    assert str(alone.value) == str(in_run.value) == WANTED + got
    assert stages.records == []
