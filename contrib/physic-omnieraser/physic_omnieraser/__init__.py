"""Inpainting backend: OmniEraser on FLUX.1-dev."""

from __future__ import annotations

from pathlib import Path

from physic_core import BackendRecord, hookimpl

__all__ = ["physic_backends", "physic_weights"]


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """Return the records of this plugin's backends. Nothing heavy is imported here, because it runs whenever plugins
    are listed.
    """
    return [
        BackendRecord(
            "inpainter",
            "omnieraser",
            "physic_omnieraser.omnieraser:OmniEraser",
            api=1,
            summary="OmniEraser on FLUX.1-dev, as in the paper",
            weights_license="FLUX.1-dev: non-commercial, by account; OmniEraser: tagged Apache-2.0, no licence file",
            needs=("GPU", "weights", "a checkout"),
            homepage="https://github.com/PRIS-CV/Omnieraser",
            packages=("accelerate", "diffusers", "peft", "torch", "transformers"),
            weights=("omnieraser",),
        ),
    ]


@hookimpl
def physic_weights() -> Path:
    """Return the folder with the manifests of this plugin's weights."""
    return Path(__file__).parent / "weights"
