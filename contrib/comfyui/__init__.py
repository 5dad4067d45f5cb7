"""A node of ComfyUI: people, scene and contact of one photo in 3D.

ComfyUI loads this folder from its custom_nodes.
"""

from __future__ import annotations

import json
import os
from functools import lru_cache
from typing import Any

import folder_paths
import numpy as np
import torch

from physic_core import Pipeline, Reconstruction
from physic_core.types import partner_titles, pelvis_distance_m
from physic_visual.panels import overlay_panel
from physic_visual.views import build_preview_geometry

NODE_DISPLAY_NAME_MAPPINGS = {"PhysicReconstruct": "PhySIC: photo to 3D people and scene"}


@lru_cache(maxsize=1)
def _pipeline(preset: str) -> Pipeline:
    """Load the backends of a preset, which stay loaded until another one is wanted."""
    return Pipeline(preset)


class PhysicReconstruct:
    """Reconstruct each image of a batch on its own; the outputs have the size of the images."""

    CATEGORY = "PhySIC"
    DESCRIPTION = "People, scene and contact of one photo in 3D, in meters."
    FUNCTION = "reconstruct"
    OUTPUT_NODE = True
    RETURN_TYPES = ("IMAGE", "IMAGE", "MASK", "STRING", "STRING")
    RETURN_NAMES = ("overlay", "depth", "masks", "glb_path", "contacts")
    OUTPUT_IS_LIST = (False, False, False, True, True)

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return the inputs; a focal length of 0 is unknown."""
        return {
            "required": {
                "image": ("IMAGE",),
                "preset": (
                    "STRING",
                    {"default": "embedded", "tooltip": "A preset of PhySIC, or a TOML file."},
                ),
                "focal_px": (
                    "FLOAT",
                    {"default": 0.0, "min": 0.0, "max": 1e6, "tooltip": "In px; 0 if unknown."},
                ),
                "filename_prefix": ("STRING", {"default": "physic/scene"}),
            }
        }

    def reconstruct(
        self, image: torch.Tensor, preset: str, focal_px: float, filename_prefix: str
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, list[str], list[str]]:
        """Reconstruct a batch of images.

        Args:
            image: (B, H, W, 3) in 0 to 1.
            preset: of PhySIC, or a TOML file.
            focal_px: focal length in px of the image; 0 if unknown.
            filename_prefix: of the GLB files, in ComfyUI's output folder.

        Returns:
            People over each photo (B, H, W, 3); depth of each scene without people (B, H, W, 3): 1
            at the nearest point, a half at twice its distance, 0 where unknown; masks of all people
            (N, H, W), one of zeros if there are none; a GLB file per image, relative to the output
            folder, as Preview3D takes it; a JSON text per image.
        """
        height, width = image.shape[1:3]
        folder, name, counter, subfolder, _ = folder_paths.get_save_image_path(
            filename_prefix, folder_paths.get_output_directory()
        )
        overlays = []
        depths = []
        masks = []
        paths = []
        contacts = []
        for number, picture in enumerate(image, counter):
            photo = np.rint(picture.cpu().numpy() * 255).clip(0, 255).astype(np.uint8)
            result = _pipeline(preset)(photo, settings={"focal_px": focal_px} if focal_px else None)
            overlay = overlay_panel(result, build_preview_geometry(result), width, height)
            overlays.append(torch.from_numpy(overlay.astype(np.float32) / 255))
            depth, nearest = _inverse_depth(result)
            depths.append(_resized(depth, height, width))
            masks += [_resized(person.mask, height, width) for person in result.people]
            file = f"{name}_{number:05}_.glb"
            result.export(os.path.join(folder, file), "glb")
            paths.append(os.path.join(subfolder, file))
            contacts.append(json.dumps(_document(result, nearest), indent=2))
        depth_image = torch.stack(depths)[..., None].expand(-1, -1, -1, 3)
        return (
            torch.stack(overlays),
            depth_image,
            torch.stack(masks or [torch.zeros(height, width)]),
            paths,
            contacts,
        )


def _inverse_depth(result: Reconstruction) -> tuple[np.ndarray, float | None]:
    """Return nearest depth / depth of each pixel (H, W), 0 where unknown, and the nearest depth in
    metres.
    """
    depth = result.scene.points[..., 2]
    valid = result.scene.valid
    if not valid.any():
        return np.zeros(depth.shape, np.float32), None
    nearest = float(depth[valid].min())
    return np.where(valid, nearest / np.where(valid, depth, 1), 0).astype(np.float32), nearest


def _resized(picture: np.ndarray, height: int, width: int) -> torch.Tensor:
    """Return a picture (H, W) in another size: PhySIC shrinks large photos."""
    tensor = torch.from_numpy(picture.astype(np.float32))
    return torch.nn.functional.interpolate(tensor[None, None], (height, width), mode="nearest")[
        0, 0
    ]


def _document(result: Reconstruction, nearest: float | None) -> dict[str, Any]:
    """Return usable marks, people and their contacts; lengths are metres."""
    titles = [partner_titles(one.partner for one in person.contacts) for person in result.people]
    people = [
        {
            "marks": person.marks,
            "trust": person.trust,
            "why": person.why,
            "distance_m": pelvis_distance_m(person),
            "contacts": [
                {
                    "part": one.part,
                    "touches": names[one.partner],
                    "probability": one.probability,
                    "assumed": one.assumed,
                }
                for one in person.contacts
            ],
        }
        for person, names in zip(result.people, titles, strict=True)
    ]
    return {
        "usable": result.usable,
        "nearest_depth_m": nearest,
        "people": people,
        "warnings": result.warnings,
    }


NODE_CLASS_MAPPINGS = {"PhysicReconstruct": PhysicReconstruct}
