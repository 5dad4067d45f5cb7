"""Mistakes of users: one message that says what is wrong, and the exit code of its kind, from every
command.
"""

from __future__ import annotations

import os
from pathlib import Path

import click
import pytest
from PIL import Image

from physic_core.cli import main
from physic_core.cli.exit_codes import INPUT, USAGE, WEIGHTS
from physic_core.io.results import save_reconstruction
from tests.cli.results import empty_reconstruction

RUN = ("run", "a.png", "--preset", "mock")
BATCH = ("batch", "a.png", "--preset", "mock", "-o", "many", "--dry-run")
SCENE = ("scene", "a.png", "b.png", "--preset", "mock", "-o", "out")
WEB = "https://example.org/a.png"


@pytest.fixture(autouse=True)
def _files():
    """Write photos, and what a user can take for another file."""
    for name in ("a.png", "b.png"):
        Image.new("RGB", (160, 120)).save(name)
    Path("folder").mkdir()
    Path("torn").mkdir()
    for name in ("text.txt", "torn/reconstruction.npz"):
        Path(name).write_text("a letter")
    for suffix in ("npy", "csv", "toml", "json", "png", "npz"):
        os.symlink(f"loop.{suffix}", f"loop.{suffix}")
        os.mkfifo(f"pipe.{suffix}")


def commands(group=main, words=()):
    """Yield the words and the object of every command."""
    context = click.Context(group)
    for name in group.list_commands(context):
        found = group.get_command(context, name)
        if isinstance(found, click.Group):
            yield from commands(found, (*words, name))
        elif found is not None:
            yield (*words, name), found


def test_no_command_takes_a_web_address_for_a_path_or_nan_for_a_number():
    checked = 0
    for words, command in commands():
        for parameter in command.params:
            wrong = {
                "path": WEB,
                "file": WEB,
                "directory": WEB,
                "float": "nan",
                "float range": "nan",
            }.get(parameter.type.name)
            if wrong is not None:
                checked += 1
                with pytest.raises(click.BadParameter):
                    print(words, parameter.name, parameter.type.convert(wrong, parameter, None))
    assert checked > 20


MISTAKES = [
    (USAGE, "downloads nothing", ("run", WEB)),
    (USAGE, "downloads nothing", (*RUN, "--depth", WEB)),
    (USAGE, "downloads nothing", (*RUN, "--set", f"photo.keypoints={WEB}")),
    (USAGE, "downloads nothing", ("batch", WEB, "-o", "many")),
    (INPUT, "no such file", ("run", "none.png")),
    (INPUT, "folder", ("run", "folder")),
    (INPUT, "not a regular file", ("run", "pipe.png")),
    *((INPUT, "no such file", (*RUN, option, f"none.{kind}")) for option, kind in
      (("--depth", "npy"), ("--pointmap", "npz"), ("--keypoints", "csv"))),
    *((INPUT, "a folder", (*RUN, option, "folder")) for option in ("--depth", "--pointmap", "--keypoints")),  # noqa: E501
    *((INPUT, "not a regular file", (*RUN, option, f"pipe.{kind}")) for option, kind in
      (("--depth", "npy"), ("--pointmap", "npz"), ("--keypoints", "json"))),
    *((INPUT, "link to itself", (*RUN, option, f"loop.{kind}")) for option, kind in
      (("--depth", "npy"), ("--pointmap", "npz"), ("--keypoints", "csv"))),
    (INPUT, "no such file", ("config", "check", "--preset", "mock", "--set", "photo.depth=none.npy")),  # noqa: E501
    (INPUT, "--set: "
            "metric_depth.options.path", (*RUN, "--set", "metric_depth.backend=file", "--set",
                                                  "metric_depth.options.path=none.npy")),
    (WEIGHTS, "none.npz", (*RUN, "--set", "body_model.path=none.npz")),
    (INPUT, "not a regular file", (*RUN, "--set", "body_model.path=pipe.npz")),
    (INPUT, "link to itself", (*RUN, "--set", "body_model.path=loop.npz")),
    *((USAGE, "link to itself", (*command, "--config", f"loop.{kind}")) for kind in ("toml", "json")
      for command in (("run", "a.png"), ("config", "show"), ("batch", "a.png", "-o", "many"))),
    *((USAGE, "not a regular file", ("config", "check", "--config", f"pipe.{kind}")) for kind in ("toml", "json")),  # noqa: E501
    (USAGE, "a folder", ("run", "a.png", "--config", "folder")),
    (USAGE, "--stature: photo.stature: a stature should be 0.4 to 2.6 metres, or 0 where unknown "
            "(got 170; 170 cm are "
            "1.7 metres)", (*RUN, "--stature", "170")),
    (USAGE, "170 cm are 1.7 metres", (*SCENE, "--stature", "170")),
    (USAGE, "0 to 120 years", (*RUN, "--age", "300")),
    (USAGE, "0 to 120 years", (*SCENE, "--age", "300")),
    (USAGE, "0.01 to 1000 metres", (*RUN, "--camera-height", "15000")),
    (USAGE, "not a finite number", (*RUN, "--focal-px", "nan")),
    (USAGE, "not a finite number", (*BATCH, "--timeout", "nan")),
    (USAGE, "not a finite number", ("plugins", "doctor", "mock", "--timeout", "nan")),
    (USAGE, "--timeout", ("plugins", "doctor", "mock", "--timeout", "-1")),
    (USAGE, "not a finite number", (*SCENE, "--camera-unit", "nan")),
    (USAGE, "--cameras", (*SCENE, "--camera-unit", "0.01")),
    (USAGE, "2 to 8 photos", ("scene", "a.png", "--preset", "mock", "-o", "out")),
    (INPUT, "no such file", (*SCENE, "--cameras", "none.toml")),
    (INPUT, "link to itself", (*SCENE, "--cameras", "loop.toml")),
    *((USAGE, "should not be true or false (got true)", (*RUN, "--set", f"{key}=true")) for key in
      ("run.threads", "photo.focal_px", "photo.max_side", "run.cache_mb")),
    (USAGE, "photo.stature: should not be true or false "
            "(got [true])", (*RUN, "--set", "photo.stature=[true]")),
    (USAGE, "metric_depth.options.noise: should not be true or false", (*RUN, "--set",
                                                                         "metric_depth.options.noise=false")),
    (USAGE, "outside the upright photo of 160 x 120 px", (*RUN, "--person", "999,9")),
    (USAGE, "outside the upright photo of 160 x 120 px", (*RUN, "--known-length", "1,1,999,9,1")),
    (USAGE, "is empty", (*RUN, "--box", "90,90,10,10")),
    (USAGE, "focal length", (*RUN, "--focal-px", "5")),
    (USAGE, "cpu, cuda or cuda:N", (*RUN, "--device", "gpu")),
    (USAGE, "cpu, cuda or cuda:N", ("plugins", "check", "mock", "--device", "gpu")),
    (USAGE, "choose one of", ("export", "result", "--to", "glbb")),
    (USAGE, "does not end in .glb", ("export", "result", "--to", "glb", "-o", "a.ply")),
    (USAGE, "there is no person 7", ("export", "result", "--to", "glb", "--person", "7")),
    (USAGE, "has no option 'rigid'", ("export", "result", "--to", "ply", "--rigid")),
    (USAGE, "choose one of", ("serve", "--preset", "mock", "--export", "fbx")),
    (INPUT, "no result in torn", ("report", "torn")),
    (USAGE, "is not a folder", ("setup", "paper", "--folder", "text.txt")),
]  # fmt: skip


@pytest.mark.parametrize(
    ("code", "words", "arguments"),
    MISTAKES,
    ids=[" ".join(arguments) for _, _, arguments in MISTAKES],
)
def test_a_mistake_is_one_message_with_the_code_of_its_kind(code, words, arguments, physic):
    if arguments[0] == "export":
        save_reconstruction(empty_reconstruction(), "result", "numbers")
    done = physic(*arguments)
    assert (done.exit_code, words in done.stderr) == (code, True), done.output
    assert done.stderr.count("Error: ") == 1
