"""OmniEraser with a stand-in for its checkout, and FLUX's own transformer, small and random."""

from __future__ import annotations

import textwrap

import numpy as np
import pytest

from physic_omnieraser.omnieraser import OmniEraser, OmniEraserOptions, widen_input
from physic_testing import check_backend

torch = pytest.importorskip("torch")
diffusers = pytest.importorskip("diffusers")

PIPELINE = '''
    """The published pipeline's signatures; it paints what is white in the mask."""
    import helper_of_the_checkout
    import cv2
    import numpy as np
    import torch
    from PIL import Image


    class Answer:
        def __init__(self, images):
            self.images = images


    class FluxControlRemovalPipeline:
        @classmethod
        def from_pretrained(cls, base, *, transformer, torch_dtype, local_files_only):
            self = cls()
            self.transformer, self.calls = transformer, [("from_pretrained", base, torch_dtype, local_files_only)]
            return self

        def load_lora_weights(self, folder, *, weight_name):
            self.calls.append(("load_lora_weights", folder, weight_name))

        def to(self, device):
            self.calls.append(("to", device))
            return self

        def enable_model_cpu_offload(self, gpu_id=None, device="cuda"):
            self.calls.append(("model", device))

        def enable_sequential_cpu_offload(self, gpu_id=None, device="cuda"):
            self.calls.append(("sequential", device))

        def __call__(self, prompt=None, prompt_2=None, control_image=None, control_mask=None, height=None, width=None,
                     num_inference_steps=28, sigmas=None, guidance_scale=3.5, num_images_per_prompt=1, generator=None,
                     latents=None, prompt_embeds=None, pooled_prompt_embeds=None, output_type="pil", return_dict=True,
                     joint_attention_kwargs=None, callback_on_step_end=None,
                     callback_on_step_end_tensor_inputs=("latents",), max_sequence_length=512):
            self.asked = dict(prompt=prompt, image=control_image, mask=control_mask, height=height, width=width,
                              steps=num_inference_steps, guidance=guidance_scale, longest=max_sequence_length)
            hole = np.asarray(control_mask.convert("L")) > 127
            painted = cv2.inpaint(np.asarray(control_image), hole.astype(np.uint8), 3, cv2.INPAINT_TELEA)
            # Noise of both generators, as the diffusion and the encoding draw it.
            noise = torch.randn(1, generator=generator) + torch.randn(1)
            return Answer([Image.fromarray(np.clip(painted + noise.numpy(), 0, 255).astype(np.uint8))])
'''  # noqa: E501


@pytest.fixture(scope="module")
def stand_in_files(tmp_path_factory):
    """Options that point at a checkout, a base and a LoRA which are stand-ins."""
    checkout = tmp_path_factory.mktemp("checkout")
    (checkout / "pipeline_flux_control_removal.py").write_text(textwrap.dedent(PIPELINE))
    (checkout / "helper_of_the_checkout.py").write_text("")
    base = tmp_path_factory.mktemp("base")
    (base / "model_index.json").write_text("{}")
    transformer().save_pretrained(base / "transformer")
    lora = tmp_path_factory.mktemp("lora") / "pytorch_lora_weights.safetensors"
    lora.write_bytes(b"lora")
    options = {"checkout": str(checkout), "base": str(base), "side": 256, "allow_cpu": True}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(OmniEraser, "file", lambda self: lora)
        yield options


@pytest.fixture
def no_packages_needed(monkeypatch):
    """The stand-in needs neither peft nor accelerate, nor weights."""
    monkeypatch.setattr(OmniEraser, "missing", lambda self: ())


def transformer():
    torch.manual_seed(0)
    return diffusers.FluxTransformer2DModel(
        patch_size=1, in_channels=4, num_layers=1, num_single_layers=1, attention_head_dim=16, num_attention_heads=2,  # noqa: E501
        joint_attention_dim=32, pooled_projection_dim=32, axes_dims_rope=(4, 4, 8),
    )  # fmt: skip


def loaded(stand_in_files, **more):
    backend = OmniEraser(OmniEraserOptions(**stand_in_files | more))
    backend.load()
    return backend


def hole(size=(60, 90)):
    mask = np.zeros(size, bool)
    mask[20:40, 30:60] = True
    return mask


def test_conformance(stand_in_files, no_packages_needed):
    check_backend(OmniEraser, options=stand_in_files).raise_if_failed()


def test_white_is_the_hole(stand_in_files):
    """Read the other way round, the wall would be painted over from the red thing, and the thing
    would stay.
    """
    photo = np.full((60, 90, 3), (180, 170, 160), np.uint8)
    photo[hole()] = 255, 0, 0
    backend = loaded(stand_in_files)
    filled = backend.infer(photo, hole())
    assert np.abs(filled[25:35, 40:50].mean((0, 1)) - (180, 170, 160)).max() < 40
    assert (filled[~hole()] == photo[~hole()]).all()
    asked = backend.network.asked
    white = np.asarray(asked["mask"])
    assert white.shape == (256, 256, 3)
    assert white[128, 128].tolist() == [255, 255, 255]
    assert white[5, 5].tolist() == [0, 0, 0]
    assert asked.pop("image").size == (256, 256)
    asked.pop("mask")
    assert asked == {  # as in the released code
        "prompt": "There is nothing here.", "height": 256, "width": 256, "steps": 28, "guidance": 3.5, "longest": 512,  # noqa: E501
    }  # fmt: skip


def test_a_widened_transformer_gives_the_same_output():
    """What the new channels hold does not count until the LoRA is on."""
    small = transformer().eval()
    rows = torch.randn(1, 6, 4)
    rest = {
        "encoder_hidden_states": torch.randn(1, 3, 32), "pooled_projections": torch.randn(1, 32),
        "timestep": torch.tensor([0.5]), "img_ids": torch.zeros(6, 3), "txt_ids": torch.zeros(3, 3),
        "return_dict": False,
    }  # fmt: skip
    with torch.no_grad():
        before = small(hidden_states=rows, **rest)[0]
        widen_input(small)
        after = small(hidden_states=torch.cat([rows, torch.randn(1, 6, 12)], -1), **rest)[0]
    assert small.config.in_channels == 16
    assert torch.allclose(before, after, atol=1e-5)
