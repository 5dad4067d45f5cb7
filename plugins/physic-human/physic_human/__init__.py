"""Backends of bodies, hands, contact and point maps that run published code or TorchScript files on the user's disk."""

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
