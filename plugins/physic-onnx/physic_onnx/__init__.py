"""Backends that run published estimators as ONNX files with onnxruntime."""

from __future__ import annotations

from pathlib import Path

from physic_core import BackendRecord, hookimpl

__all__ = ["physic_backends", "physic_weights"]


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """Return the records of this plugin's backends."""
    return [
        BackendRecord(
            "segmenter",
            "sam2-onnx",
            "physic_onnx.sam2:Sam2",
            api=1,
            summary="SAM 2.1 masks in boxes of YOLOX, RT-DETR or RTMO; floor from points under the feet",
            weights_license="Apache-2.0 (SAM 2, YOLOX, RT-DETR, RTMO)",
            needs=("weights",),
            weights=("sam2.1-hiera-tiny", "rtdetr-r50"),
        ),
        BackendRecord(
            "inpainter",
            "lama-onnx",
            "physic_onnx.lama:Lama",
            api=1,
            summary="LaMa: ONNX files of two origins, or TorchScript",
            weights_license="Apache-2.0 (LaMa)",
            needs=("weights",),
            weights=("lama-carve",),
        ),
        BackendRecord(
            "metric_depth",
            "moge-2-onnx",
            "physic_onnx.moge:Moge2Depth",
            api=1,
            summary="MoGe-2: depth in metres and the focal length",
            weights_license="MIT (MoGe-2), Apache-2.0 (DINOv2)",
            needs=("weights",),
            weights=("moge-2-vits-normal",),
        ),
        BackendRecord(
            "metric_depth",
            "depth-anything-v2-metric-onnx",
            "physic_onnx.depth_anything:DepthAnythingMetric",
            api=1,
            summary="Depth Anything V2 metric, indoors or outdoors",
            weights_license="Apache-2.0 (small); CC-BY-NC-4.0 (base, large)",
            needs=("weights",),
            weights=("depth-anything-v2-metric-indoor-small",),
        ),
        BackendRecord(
            "metric_depth",
            "depth-anything-3-metric-onnx",
            "physic_onnx.depth_anything_3:DepthAnything3",
            api=1,
            summary="Depth Anything 3 metric; needs the focal length",
            weights_license="Apache-2.0 (DA3METRIC-LARGE)",
            needs=("weights",),
            weights=("depth-anything-3-metric-large",),
        ),
        BackendRecord(
            "relative_pointmap",
            "moge-2-onnx",
            "physic_onnx.moge:Moge2Pointmap",
            api=1,
            summary="MoGe-2 without its scale: points and the focal length",
            weights_license="MIT (MoGe-2), Apache-2.0 (DINOv2)",
            needs=("weights",),
            weights=("moge-2-vits-normal",),
        ),
        BackendRecord(
            "relative_pointmap",
            "depth-anything-onnx",
            "physic_onnx.depth_anything:DepthAnythingRelative",
            api=1,
            summary="Depth Anything V2 or 3 relative: disparity up to scale and shift",
            weights_license="Apache-2.0 (small); CC-BY-NC-4.0 (base, large)",
            needs=("weights",),
            weights=("depth-anything-v2-small",),
        ),
        BackendRecord(
            "keypoint_detector",
            "vitpose-onnx",
            "physic_onnx.vitpose:VitPose",
            api=1,
            summary="ViTPose: 133 whole-body keypoints, or 17",
            weights_license="Apache-2.0 (ViTPose, easy_ViTPose)",
            needs=("weights",),
            weights=("vitpose-b-wholebody",),
        ),
        BackendRecord(
            "keypoint_detector",
            "rtmpose-onnx",
            "physic_onnx.rtmpose:RtmPose",
            api=1,
            summary="RTMPose, RTMW or DWPose: 133, 26 or 17 keypoints",
            weights_license="Apache-2.0 (MMPose)",
            needs=("weights",),
            weights=("rtmw-l-384x288",),
        ),
        BackendRecord(
            "body_estimator",
            "instanthmr-onnx",
            "physic_onnx.instanthmr:InstantHmr",
            api=1,
            summary="InstantHMR: joints of MHR bodies, by a small network that was trained on SAM 3D Body's data",
            weights_license="SAM License: commercial use with conditions (InstantHMR)",
            needs=("weights",),
            weights=("instanthmr",),
        ),
    ]


@hookimpl
def physic_weights() -> Path:
    """Return the folder with the manifests of this plugin's weights."""
    return Path(__file__).parent / "weights"
