"""Random numbers of a seed, float64."""

from __future__ import annotations

import torch


def normal(*shape, seed=0):
    """Return numbers of a normal distribution."""
    draws = torch.Generator().manual_seed(seed)
    return torch.randn(shape, generator=draws, dtype=torch.float64)


def uniform(*shape, seed=0):
    """Return numbers from 0 to 1."""
    draws = torch.Generator().manual_seed(seed)
    return torch.rand(shape, generator=draws, dtype=torch.float64)
