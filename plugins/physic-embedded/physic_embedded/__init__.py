"""Default backends: small networks that are part of the package, and a body fit. No account, download or GPU is needed.

onnxruntime runs the networks.
"""

from __future__ import annotations

from physic_core import BackendRecord, hookimpl

__all__ = ["physic_backends"]


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """Return the records of this plugin's backends."""
    return [
        BackendRecord(
            "segmenter",
            "embedded",
            "physic_embedded.segmenter:EmbeddedSegmenter",
            api=1,
            summary="People by YOLOX and BlazePose, masks by MobileSAM, surfaces by DeepLabv3 on ADE20K",
            weights_license="Apache-2.0 (YOLOX, MediaPipe BlazePose, MobileSAM, DeepLabv3), MIT (TinyViT)",
        ),
        BackendRecord(
            "inpainter",
            "embedded",
            "physic_embedded.inpainter:MiGan",
            api=1,
            summary="MI-GAN, 512 px, trained on Places2",
            weights_license="MIT (MI-GAN)",
        ),
        BackendRecord(
            "metric_depth",
            "embedded",
            "physic_embedded.metric_depth:EmbeddedMetricDepth",
            api=1,
            summary="Scale from the people: soles on the floor where both are seen, else body size",
        ),
        BackendRecord(
            "relative_pointmap",
            "embedded",
            "physic_embedded.relative_pointmap:EmbeddedPointmap",
            api=1,
            summary="Depth Anything V2 small; shift and focal length from horizon and straight lines (M-LSD)",
            weights_license="Apache-2.0 (Depth Anything V2 Small, DINOv2, M-LSD)",
        ),
        BackendRecord(
            "keypoint_detector",
            "embedded",
            "physic_embedded.keypoint_detector:EmbeddedKeypoints",
            api=1,
            summary="BlazePose landmarks, 33 a person, for several people",
            weights_license="Apache-2.0 (MediaPipe BlazePose)",
        ),
        BackendRecord(
            "body_estimator",
            "embedded",
            "physic_embedded.body_estimator:EmbeddedBodies",
            api=1,
            summary="The embedded body fitted to 2D and world landmarks with priors",
        ),
        BackendRecord(
            "hand_estimator",
            "embedded",
            "physic_embedded.hand_estimator:EmbeddedHands",
            api=1,
            summary="MediaPipe palm and hand landmarks turned into finger rotations",
            weights_license="Apache-2.0 (MediaPipe Hands)",
        ),
        BackendRecord(
            "contact_prior",
            "embedded",
            "physic_embedded.contact_prior:StaticContact",
            api=1,
            summary="Feet, thighs, gluteus, back and hands after PROX, for every pose alike",
        ),
    ]
