"""Export a published EoMT checkpoint to the ONNX file that the backend eomt-onnx runs.

    python tools/export_eomt.py tue-mps/coco_panoptic_eomt_base_640_2x model.onnx

Needs torch, transformers and onnx. The checkpoint is a name on Hugging Face's hub or a folder; only panoptic ones of
COCO (134 numbers a query) are of use.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path


def export(checkpoint: str, target: Path) -> None:
    """Write ``target``: pixel_values (1, 3, S, S) -> class_queries_logits, masks_queries_logits."""
    import torch
    from transformers import EomtForUniversalSegmentation

    model = EomtForUniversalSegmentation.from_pretrained(checkpoint).eval()
    classes = model.config.num_labels
    if classes != 133:
        raise SystemExit(f"{checkpoint} knows {classes} classes, and COCO panoptic has 133: choose another checkpoint")

    class Graph(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, pixel_values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            answer = self.model(pixel_values=pixel_values)
            return answer.class_queries_logits, answer.masks_queries_logits

    side = model.config.image_size
    target.parent.mkdir(parents=True, exist_ok=True)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # the newer exporter fails on this network
        torch.onnx.export(
            Graph(),
            (torch.zeros(1, 3, side, side),),
            str(target),
            input_names=["pixel_values"],
            output_names=["class_queries_logits", "masks_queries_logits"],
            opset_version=17,
            dynamo=False,
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("checkpoint", help="a name on Hugging Face's hub, or a folder")
    parser.add_argument("target", type=Path, help="the ONNX file to write")
    arguments = parser.parse_args()
    export(arguments.checkpoint, arguments.target)
    print(f"wrote {arguments.target}")
