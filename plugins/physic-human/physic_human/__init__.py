"""Backends of bodies, hands, contact and depth that run published code or TorchScript files on the user's disk."""

from __future__ import annotations

from pathlib import Path

from physic_core import BackendRecord, hookimpl

__all__ = ["physic_backends", "physic_weights"]


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """Return the records of this plugin's backends."""
    return [
        BackendRecord(
            "body_estimator",
            "nlf",
            "physic_human.nlf:Nlf",
            api=1,
            summary="NLF: SMPL-X or SMPL bodies in metres from one TorchScript file",
            weights_license="non-commercial research (NLF)",
            needs=("weights",),
            packages=("torchvision",),
            weights=("nlf-l",),
        ),
        BackendRecord(
            "body_estimator",
            "camerahmr",
            "physic_human.camerahmr:CameraHmr",
            api=1,
            summary="CameraHMR from its checkout: SMPL bodies: the paper's",
            weights_license="MPI: non-commercial (CameraHMR, SMPL)",
            needs=("a checkout", "weights", "a SMPL file"),
            weights=("camerahmr",),
        ),
        BackendRecord(
            "body_estimator",
            "sam-3d-body",
            "physic_human.sam3d_body:Sam3dBody",
            api=1,
            summary="SAM 3D Body from its checkout: MHR bodies",
            weights_license="SAM License: commercial use with conditions, gated; DINOv3 License for its DINOv3 weights",
            needs=("GPU", "a checkout", "weights"),
            weights=("sam-3d-body-vith",),
        ),
        BackendRecord(
            "hand_estimator",
            "wilor",
            "physic_human.wilor:Wilor",
            api=1,
            summary="WiLoR from its checkout: the paper's",
            weights_license="CC-BY-NC-ND-4.0 (WiLoR), MPI: non-commercial (MANO)",
            needs=("a checkout", "weights"),
            weights=("wilor-mini",),
        ),
        BackendRecord(
            "hand_estimator",
            "hamer",
            "physic_human.hamer:Hamer",
            api=1,
            summary="HaMeR from its checkout",
            weights_license="MIT (HaMeR), MPI: non-commercial (MANO)",
            needs=("a checkout", "weights"),
            weights=("hamer",),
        ),
        BackendRecord(
            "contact_prior",
            "deco",
            "physic_human.deco:Deco",
            api=1,
            summary="DECO from its checkout: the paper's",
            weights_license="MPI: non-commercial (DECO)",
            needs=("a checkout", "weights", "a SMPL file"),
            weights=("deco",),
        ),
        BackendRecord(
            "contact_prior",
            "interactvlm-results",
            "physic_human.interactvlm:InteractVlmResults",
            api=1,
            summary="Contact that InteractVLM wrote into files earlier",
            weights_license="MPI: non-commercial (InteractVLM)",
            needs=("its result files",),
        ),
        BackendRecord(
            "metric_depth",
            "unidepth-v2",
            "physic_human.unidepth:UniDepth",
            api=1,
            summary="UniDepth V2 from its checkout: depth in metres and the camera",
            weights_license="CC-BY-NC-4.0 (UniDepth V2)",
            needs=("a checkout", "weights"),
            weights=("unidepth-v2-vitl14",),
        ),
        BackendRecord(
            "relative_pointmap",
            "moge-1",
            "physic_human.moge:Moge1",
            api=1,
            summary="MoGe 1 from its checkout: points and the focal length: the paper's",
            weights_license="MIT (MoGe)",
            needs=("a checkout", "weights"),
            weights=("moge-1-vitl",),
        ),
    ]


@hookimpl
def physic_weights() -> Path:
    """Return the folder with the manifests of this plugin's weights."""
    return Path(__file__).parent / "weights"
