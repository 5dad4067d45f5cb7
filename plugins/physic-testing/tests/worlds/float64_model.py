"""The embedded body model in double precision."""

from __future__ import annotations

from functools import cache

import torch

from physic_core.body import load_body
from physic_core.body.model import BodyModel


@cache
def float64_model() -> BodyModel:
    return load_body("embedded").to(dtype=torch.float64)
