"""Tiny random networks of the real classes, saved as the published ones are, and tokenizers of a
few words.
"""

from __future__ import annotations

import json

import pytest

WORDS = (
    "[PAD]",
    "[UNK]",
    "[CLS]",
    "[SEP]",
    ".",
    ",",
    "person",
    "ground",
    "floor",
    "carpet",
    "##s",
    "a",
)


def write_bert_tokenizer(folder):
    """A WordPiece tokenizer of ``WORDS``, as GroundingDINO's repositories hold one."""
    from transformers import BertTokenizerFast

    vocabulary = folder / "vocab.txt"
    vocabulary.write_text("\n".join(WORDS) + "\n", "utf-8")
    BertTokenizerFast(str(vocabulary), do_lower_case=True).save_pretrained(str(folder))


def write_clip_tokenizer(folder):
    """A byte-pair tokenizer of a few letters, as SAM 3's repository holds one."""
    from transformers import CLIPTokenizerFast

    letters = sorted(set("personfloorcarpet,."))
    names = [
        *letters,
        *(f"{letter}</w>" for letter in letters),
        "pe",
        "fl",
        "<|startoftext|>",
        "<|endoftext|>",
    ]
    (folder / "vocab.json").write_text(
        json.dumps({name: i for i, name in enumerate(names)}), "utf-8"
    )
    (folder / "merges.txt").write_text("#version: 0.2\np e\nf l\n", "utf-8")
    CLIPTokenizerFast(str(folder / "vocab.json"), str(folder / "merges.txt")).save_pretrained(
        str(folder)
    )


def grounding_dino():
    from transformers import (
        BertConfig,
        GroundingDinoConfig,
        GroundingDinoForObjectDetection,
        SwinConfig,
    )

    backbone = SwinConfig(
        embed_dim=8,
        depths=[1, 1, 1, 1],
        num_heads=[1, 1, 2, 2],
        window_size=4,
        out_features=["stage2", "stage3", "stage4"],
    )
    text = BertConfig(
        vocab_size=len(WORDS),
        hidden_size=16,
        num_hidden_layers=1,
        num_attention_heads=2,
        intermediate_size=16,
    )
    return GroundingDinoForObjectDetection(
        GroundingDinoConfig(
            backbone_config=backbone,
            text_config=text,
            d_model=32,
            num_queries=10,
            encoder_layers=1,
            decoder_layers=2,
            encoder_ffn_dim=16,
            decoder_ffn_dim=16,
            encoder_attention_heads=2,
            decoder_attention_heads=2,
            encoder_n_points=2,
            decoder_n_points=2,
        )
    )


def sam2_config():
    return {
        "vision_config": {
            "model_type": "sam2_vision_model",
            "backbone_config": {
                "model_type": "sam2_hiera_det_model", "hidden_size": 8, "image_size": [128, 128],
                "blocks_per_stage": [1, 1, 2, 1],
                "embed_dim_per_stage": [8, 16, 32, 64], "num_attention_heads_per_stage": [1, 1, 1, 1],  # noqa: E501
                "window_size_per_stage": [4, 2, 2, 2], "global_attention_blocks": [3],
                "window_positional_embedding_background_size": [4, 4],
            },
            "backbone_channel_list": [64, 32, 16, 8], "fpn_hidden_size": 32,
            "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
        },
        "prompt_encoder_config": {"hidden_size": 32, "image_size": 128, "mask_input_channels": 4},
        "mask_decoder_config": {
            "hidden_size": 32, "mlp_dim": 32, "num_attention_heads": 2, "iou_head_hidden_dim": 16,
        },
    }  # fmt: skip


def sam2():
    from transformers import Sam2Config, Sam2Model

    return Sam2Model(Sam2Config(**sam2_config()))


def sam3_config():
    small = {"hidden_size": 32, "num_attention_heads": 2, "intermediate_size": 32, "num_layers": 1}
    return {
        "vision_config": {
            "model_type": "sam3_vision_model",
            "backbone_config": {
                "model_type": "sam3_vit_model", "hidden_size": 32, "intermediate_size": 32,
                "num_hidden_layers": 2, "num_attention_heads": 2, "image_size": 112,
                "patch_size": 14, "window_size": 4, "global_attn_indexes": [1],
                "pretrain_image_size": 56,
            },
            "fpn_hidden_size": 32, "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
        },
        "text_config": {
            "model_type": "clip_text_model", "vocab_size": 64, "hidden_size": 32,
            "intermediate_size": 32, "projection_dim": 16, "num_hidden_layers": 1,
            "num_attention_heads": 2, "max_position_embeddings": 32, "bos_token_id": 0,
            "eos_token_id": 1, "pad_token_id": 1,
        },
        "geometry_encoder_config": dict(small), "detr_encoder_config": dict(small),
        "detr_decoder_config": {**small, "num_queries": 12},
        "mask_decoder_config": {"hidden_size": 32, "num_attention_heads": 2},
    }  # fmt: skip


def sam3():
    from transformers import Sam3Config, Sam3Model

    return Sam3Model(Sam3Config(**sam3_config()))


MEMORY = {
    "memory_attention_hidden_size": 32,
    "memory_attention_num_layers": 1,
    "memory_attention_num_attention_heads": 1,
    "memory_attention_feed_forward_hidden_size": 32,
    "memory_attention_rope_feat_sizes": [8, 8],
    "memory_encoder_hidden_size": 32,
    "memory_encoder_output_channels": 16,
    "mask_downsampler_embed_dim": 32,
    "memory_fuser_num_layers": 1,
    "memory_fuser_embed_dim": 32,
    "memory_fuser_intermediate_dim": 32,
}
"""Of the trackers in videos, of SAM 2 and of SAM 3."""


def sam2_video():
    from transformers import Sam2VideoConfig, Sam2VideoModel

    return Sam2VideoModel(Sam2VideoConfig(**sam2_config(), **MEMORY, image_size=128))


def sam3_video():
    from transformers import Sam3VideoConfig, Sam3VideoModel

    detector = {"model_type": "sam3", **sam3_config()}
    tracker = {"model_type": "sam3_tracker_video", **sam2_config(), **MEMORY, "image_size": 112}
    tracker["vision_config"] = sam3_config()["vision_config"]
    tracker["prompt_encoder_config"] |= {"image_size": 112, "patch_size": 14}
    return Sam3VideoModel(Sam3VideoConfig(detector_config=detector, tracker_config=tracker))


def depth_pro():
    from transformers import DepthProConfig, DepthProForDepthEstimation

    encoder = {
        "model_type": "dinov2", "image_size": 32, "patch_size": 8, "hidden_size": 16,
        "num_hidden_layers": 2, "num_attention_heads": 2, "mlp_ratio": 1,
    }  # fmt: skip
    return DepthProForDepthEstimation(
        DepthProConfig(
            patch_size=32,
            fusion_hidden_size=16,
            intermediate_hook_ids=[1, 0],
            intermediate_feature_dims=[8, 8],
            scaled_images_feature_dims=[8, 8, 8],
            use_fov_model=True,
            num_fov_head_layers=2,
            image_model_config=dict(encoder),
            patch_model_config=dict(encoder),
            fov_model_config=dict(encoder),
        )
    )


_TOKENIZERS = {
    grounding_dino: write_bert_tokenizer,
    sam3: write_clip_tokenizer,
    sam3_video: write_clip_tokenizer,
}


@pytest.fixture(autouse=True)
def _own_places(monkeypatch, tmp_path):
    """Neither the user's weights nor the network are for the tests."""
    from huggingface_hub import constants

    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path / "weights"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))


@pytest.fixture(scope="session")
def saved(tmp_path_factory):
    """The folder of a tiny network by the name of its function here, written once."""
    import torch
    from transformers.utils import logging

    done = {}

    def folder(name):
        if name not in done:
            make = globals()[name]
            done[name] = tmp_path_factory.mktemp(name)
            logging.disable_progress_bar()
            with torch.random.fork_rng():
                torch.manual_seed(0)
                make().save_pretrained(str(done[name]))
            logging.enable_progress_bar()
            if make in _TOKENIZERS:
                _TOKENIZERS[make](done[name])
        return done[name]

    return folder
