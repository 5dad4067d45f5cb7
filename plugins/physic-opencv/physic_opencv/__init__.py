"""Classical OpenCV backends: inpainting, and depth and point maps of the user's files."""

from __future__ import annotations

from physic_core import BackendRecord, hookimpl

__all__ = ["physic_backends"]


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """Return the records of this plugin's backends."""
    return [
        BackendRecord(
            "inpainter",
            "telea",
            "physic_opencv.inpaint:Telea",
            api=1,
            summary="Telea 2004: fast marching from the rim inwards",
        ),
        BackendRecord(
            "inpainter",
            "navier-stokes",
            "physic_opencv.inpaint:NavierStokes",
            api=1,
            summary="Bertalmio 2001: continues the lines of equal brightness",
        ),
        BackendRecord(
            "metric_depth",
            "file",
            "physic_opencv.from_file:DepthFile",
            api=1,
            summary="A depth map of yours: .npy, 16-bit .png or .exr",
            needs=("a depth map of yours",),
        ),
        BackendRecord(
            "relative_pointmap",
            "file",
            "physic_opencv.from_file:PointmapFile",
            api=1,
            summary="A point map of yours: .npy or .npz",
            needs=("a point map of yours",),
        ),
    ]
