"""Published estimators through Hugging Face transformers."""

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
            "grounded-sam2-hf",
            "physic_transformers.grounded_sam2:GroundedSam2",
            api=1,
            summary="GroundingDINO finds people and floor by words, SAM 2.1 masks them: the paper's",
            weights_license="Apache-2.0 (GroundingDINO, SAM 2.1)",
            needs=("weights",),
            weights=("grounding-dino-base-hf", "sam2.1-hiera-large-hf"),
        ),
        BackendRecord(
            "segmenter",
            "sam3-hf",
            "physic_transformers.sam3:Sam3",
            api=1,
            summary="SAM 3 finds people and floor by words",
            weights_license="SAM License: commercial use with conditions, gated (SAM 3)",
            needs=("weights",),
            weights=("sam3-hf",),
        ),
        BackendRecord(
            "segmenter",
            "eomt-hf",
            "physic_transformers.eomt:Eomt",
            api=1,
            summary="EoMT panoptic masks of people and floor, one network",
            weights_license="MIT (EoMT)",
            needs=("weights",),
            weights=("eomt-large-640-hf",),
        ),
        BackendRecord(
            "metric_depth",
            "depth-pro-hf",
            "physic_transformers.depth_pro:DepthPro",
            api=1,
            summary="DepthPro: depth in metres and the focal length: the paper's",
            weights_license="Apple AMLR: research only (DepthPro)",
            needs=("weights",),
            weights=("depth-pro-hf",),
        ),
        BackendRecord(
            "metric_depth",
            "zoedepth-hf",
            "physic_transformers.zoedepth:ZoeDepth",
            api=1,
            summary="ZoeDepth",
            weights_license="MIT (ZoeDepth)",
            needs=("weights",),
            weights=("zoedepth-nyu-kitti-hf",),
        ),
        BackendRecord(
            "keypoint_detector",
            "sapiens2-hf",
            "physic_transformers.sapiens2:Sapiens2",
            api=1,
            summary="Sapiens2: body, hands and feet of its 308 keypoints",
            weights_license="Sapiens2 License: no surveillance, no biometric processing (Sapiens2)",
            needs=("weights",),
            weights=("sapiens2-pose-0.4b-hf",),
        ),
    ]


@hookimpl
def physic_weights() -> Path:
    """Return the folder with the manifests of this plugin's weights."""
    return Path(__file__).parent / "weights"
