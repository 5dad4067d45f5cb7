"""Remove people from a photo with OmniEraser, as in PhySIC's released code."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import DeviceError, WeightsMissingError
from physic_core.interfaces import GpuMemory, Inpainter, Options, Requirement, UserFile
from physic_networks.checkouts import Checkout
from physic_networks.networks import WEIGHTS_HELP, TorchBackend

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

HOMEPAGE = "https://github.com/PRIS-CV/Omnieraser"
COMMIT = "2d2ffac1f0b4ebb5ca56fba0fee7c9c9ba65840b"
"""Of the repository's train_control_lora_flux.py, which imports the pipeline; it was read there,
and not run.
"""
MODULE = "pipeline_flux_control_removal"
PIPELINE = "FluxControlRemovalPipeline"
FLUX_PAGE = "https://huggingface.co/black-forest-labs/FLUX.1-dev"
FLUX_BYTES = 34_000_000_000
"""Approximate size of the parts of FLUX.1-dev that the pipeline reads."""
CHANNEL_FACTOR = 4
"""Number of maps side by side in the transformer's input: noise, the photo with and without the
object, the mask.
"""


class OmniEraserOptions(Options):
    """Settings of OmniEraser; the defaults are those of PhySIC's released code."""

    checkout: str = Field(
        "", description="folder of a checkout of OmniEraser, which has its pipeline"
    )
    base: str = Field(
        "black-forest-labs/FLUX.1-dev",
        description="FLUX.1-dev: a name in Hugging Face's cache, or a folder",
    )
    weights: str = Field("omnieraser", description=WEIGHTS_HELP)
    offload: Literal["none", "model", "sequential"] = Field(
        "model",
        description="what stays in CPU memory until it is used: nothing (60 GB of GPU "
        "memory), whole networks "
        "(40 GB), or each layer (a few GB, slow)",
    )
    side: int = Field(
        1024,
        ge=256,
        le=10_000,
        multiple_of=16,
        description="side of the square that the photo is resized to, px",
    )
    steps: int = Field(28, ge=1, le=1000, description="of the diffusion; 20-50")
    guidance: float = Field(
        3.5, ge=0, le=100, description="guidance scale, the weight of the prompt; 2-5"
    )
    seed: int = Field(
        42, ge=0, le=2**32 - 1, description="seed of the noise: another seed gives another fill"
    )
    prompt: str = Field(
        "There is nothing here.", description="prompt for the background that remains"
    )
    allow_cpu: bool = Field(False, description="run without a GPU anyway; a photo takes hours")


class OmniEraser(TorchBackend, Inpainter):
    """Inpainter: FLUX.1-dev with OmniEraser's LoRA, in the pipeline of its repository.

    It takes shadows and mirror images of the removed out as far as the mask covers them: outside of
    the mask the photo stays as it was.
    """

    written_for = 1
    Options = OmniEraserOptions
    options: OmniEraserOptions

    def __init__(self, options: OmniEraserOptions | None = None) -> None:
        super().__init__(options)
        self._checkout = Checkout(
            self.options.checkout,
            name="OmniEraser",
            package=MODULE,
            homepage=HOMEPAGE,
            commit=COMMIT,
            needs=("torch", "diffusers", "transformers", "accelerate", "peft"),
        )

    def load(self, device: str = "cpu") -> None:
        """Read FLUX.1-dev, widen its input layer, and add the LoRA. Nothing is downloaded."""
        if device == "cpu" and not self.options.allow_cpu:
            raise DeviceError(
                "OmniEraser needs a GPU: choose device 'cuda', or allow_cpu, which takes hours"
            )
        super().load(device)

    def build(self, device: str) -> Any:
        """Return the pipeline of the checkout."""
        if lack := self._missing_base_model():
            raise WeightsMissingError(lack[0])
        lora = self.file()
        lora = lora / "pytorch_lora_weights.safetensors" if lora.is_dir() else lora
        kind = self._checkout.attribute(PIPELINE)
        import torch
        from diffusers import FluxTransformer2DModel

        here = {"torch_dtype": torch.bfloat16, "local_files_only": True}
        with self._checkout.activated():
            transformer = FluxTransformer2DModel.from_pretrained(
                self.options.base, subfolder="transformer", **here
            )
            widen_input(transformer)
            pipeline = kind.from_pretrained(self.options.base, transformer=transformer, **here)
            pipeline.load_lora_weights(str(lora.parent), weight_name=lora.name)
            if self.options.offload == "model" and device != "cpu":
                pipeline.enable_model_cpu_offload(device=device)
            elif self.options.offload == "sequential" and device != "cpu":
                pipeline.enable_sequential_cpu_offload(device=device)
            else:
                pipeline.to(device)
        return pipeline

    def close(self) -> None:
        """Release the networks."""
        super().close()
        self._checkout.close()

    def missing(self) -> tuple[str, ...]:
        """Describe missing checkout, packages, FLUX.1-dev and LoRA."""
        return (*self._checkout.missing(), *self._missing_base_model(), *super().missing())

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the repository, its packages, FLUX.1-dev, and the memory of the GPU."""
        advice = (
            f"accept the license (non-commercial) on {FLUX_PAGE}, then `hf auth login` and "
            f"`hf download {self.options.base}`; or set base to a folder that has it"
        )
        here = not self._missing_base_model()
        flux = UserFile("", self.options.base, advice, FLUX_PAGE, FLUX_BYTES, here)
        gigabytes = {"none": 60, "model": 40, "sequential": 8}[self.options.offload]
        memory = GpuMemory(
            gigabytes, f"README of PhySIC's released code, for offload = '{self.options.offload}'"
        )
        return (*self._checkout.requirements(), flux, memory)

    def fingerprint(self) -> str:
        """Return the identity of LoRA and checkout."""
        return f"{super().fingerprint()} {self._checkout.fingerprint()}"

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); pixels outside the mask stay
        identical.

        Raises:
            InputError: the image is not a valid photo.
            BackendError: the mask has another size or leaves nothing to go by, or load() was not
                called.
        """
        from physic_networks.pictures import inpaint_masked

        self.network  # noqa: B018 -- raises an error if it is not loaded
        return inpaint_masked(image, mask, 0.0, self._fill)

    def _fill(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Run the pipeline on the photo, squashed to the network's square and back."""
        import torch
        from PIL import Image

        options = self.options
        square = (self.options.side, self.options.side)
        photo = Image.fromarray(np.ascontiguousarray(image)).resize(
            square, Image.Resampling.LANCZOS
        )
        white = (
            Image.fromarray(mask.astype(np.uint8) * 255)
            .convert("RGB")
            .resize(square, Image.Resampling.LANCZOS)
        )
        cuda = [torch.device(self.device)] if self.device != "cpu" else []
        with self._checkout.activated(), torch.random.fork_rng(devices=cuda):
            torch.manual_seed(options.seed)  # the pipeline also draws from the common generator
            filled = self.network(
                prompt=options.prompt,
                control_image=photo,
                control_mask=white,
                width=options.side,
                height=options.side,
                num_inference_steps=options.steps,
                generator=torch.Generator(device=self.device).manual_seed(options.seed),
                guidance_scale=options.guidance,
                max_sequence_length=512,
            ).images[0]
        height, width = mask.shape
        return np.asarray(filled.convert("RGB").resize((width, height), Image.Resampling.LANCZOS))

    def _missing_base_model(self) -> tuple[str, ...]:
        """Describe a missing FLUX.1-dev."""
        base = Path(os.path.expanduser(self.options.base))
        if base.is_dir():
            return (
                ()
                if (base / "model_index.json").is_file()
                else (f"{base} is not a diffusers pipeline",)
            )
        try:
            from huggingface_hub import try_to_load_from_cache

            if isinstance(try_to_load_from_cache(self.options.base, "model_index.json"), str):
                return ()
        except (ImportError, ValueError):
            pass  # no one looks for it then, and it is missing all the same
        return (
            f"{self.options.base} is not here (about 34 GB, non-commercial, an account with "
            "access): accept its license on huggingface.co, then `hf auth login` and `hf download "
            f"{self.options.base}`; or set base to a folder that has it",
        )


def widen_input(transformer: Any) -> None:
    """Widen the input layer of a FLUX transformer to four times as many channels; the new weights
    are zero.
    """
    import torch

    old = transformer.x_embedder
    channels = transformer.config.in_channels
    with torch.no_grad():
        new = torch.nn.Linear(
            CHANNEL_FACTOR * old.in_features,
            old.out_features,
            bias=old.bias is not None,
            dtype=old.weight.dtype,
            device=old.weight.device,
        )
        new.weight.zero_()
        new.weight[:, : old.in_features] = old.weight
        if old.bias is not None:
            new.bias.copy_(old.bias)
    transformer.x_embedder = new
    transformer.register_to_config(in_channels=CHANNEL_FACTOR * channels)
