"""Cameras of several photos of one moment by published networks: LightGlue with DISK, and Depth Anything 3."""

from __future__ import annotations

from pathlib import Path

from physic_core import BackendRecord, hookimpl

__all__ = ["physic_backends", "physic_weights"]


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """Return the records of the camera solvers."""
    return [
        BackendRecord(
            "camera_solver",
            "lightglue",
            "physic_cameras.lightglue:LightGlueCameras",
            api=1,
            summary="LightGlue and DISK match the background of photos; not measured",
            weights_license="Apache-2.0 (DISK, LightGlue)",
            needs=("weights",),
            weights=("disk-lightglue",),
        ),
        BackendRecord(
            "camera_solver",
            "depth-anything-3",
            "physic_cameras.depth_anything_3:DepthAnything3Cameras",
            api=1,
            summary="Depth Anything 3 estimates all cameras at once; not measured",
            weights_license="Apache-2.0 (Depth Anything 3, base and small)",
            needs=("weights",),
            packages=("depth_anything_3", "addict", "einops", "omegaconf"),
            weights=("depth-anything-3-base",),
        ),
    ]


@hookimpl
def physic_weights() -> Path:
    """Return the folder with the manifests of this plugin's weights."""
    return Path(__file__).parent / "weights"
