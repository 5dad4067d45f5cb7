"""Tiny random networks of the real classes, saved as the published ones are, and tokenizers of a
few words.
"""

from __future__ import annotations

import json
from pathlib import Path

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


TINY = json.loads(Path(__file__).with_name("tiny_networks.json").read_text("utf-8"))
"""Class and config.json of each network."""

_TOKENIZERS = {
    "grounding_dino": write_bert_tokenizer,
    "sam3": write_clip_tokenizer,
    "sam3_video": write_clip_tokenizer,
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
    """The folder of a tiny network by its name, written once."""
    import torch
    import transformers
    from transformers.utils import logging

    done = {}

    def folder(name):
        if name not in done:
            kind = getattr(transformers, TINY[name]["network"])
            done[name] = tmp_path_factory.mktemp(name)
            logging.disable_progress_bar()
            with torch.random.fork_rng():
                torch.manual_seed(0)
                config = kind.config_class(**TINY[name]["config"])
                kind(config).save_pretrained(str(done[name]))
            logging.enable_progress_bar()
            if name in _TOKENIZERS:
                _TOKENIZERS[name](done[name])
        return done[name]

    return folder


@pytest.fixture
def stored(saved):
    """``stored(Adapter, {option: network}, **options)``: a backend that reads tiny networks."""

    def make(kind, networks, **options):
        backend = kind(kind.Options(**options))
        backend.file = lambda name=None, option="weights": saved(networks[option])
        return backend

    return make
