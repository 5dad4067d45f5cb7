"""Mistakes of users: one message that says what is wrong, and the exit code of its kind, from every
command.
"""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import click
import pytest
from PIL import Image

from physic_core.cli import main
from physic_core.cli.exit_codes import INPUT, USAGE, WEIGHTS
from physic_core.io.results import save_reconstruction
from tests.cli.results import empty_reconstruction

RUN = "run a.png --preset mock"
BATCH = "batch a.png --preset mock -o many --dry-run"
SCENE = "scene a.png b.png --preset mock -o out"
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
    Path("windows.toml").write_text('[photo]\ndepth = "C:\\Users\\me\\d.npy"\n')
    Path("comma.toml").write_text("[photo]\nstature = [1,7]\nfocal_px = 1,7\n")
    Path("semicolons.csv").write_text("path;stature\na.png;1,75\n")
    Path("tabs.csv").write_text("person\tjoint\tx\ty\n0\tnose\t8\t9\n")
    Path("list.toml").write_text("[[cameras]]\nsize = [160, 120]\n")
    Path("other.json").write_text("{}")
    for suffix in ("csv", "toml"):
        Path(f"utf16.{suffix}").write_text("path = 'a.png'\n", encoding="utf-16")
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
    (USAGE, "downloads nothing", f"run {WEB}"),
    (USAGE, "downloads nothing", f"{RUN} --set photo.keypoints={WEB}"),
    (INPUT, "no such file", "run none.png"),
    (INPUT, "folder", "run folder"),
    (INPUT, "not a regular file", "run pipe.png"),
    *(
        (INPUT, words, f"{RUN} --{option} {path}")
        for option, suffix in (("depth", "npy"), ("pointmap", "npz"), ("keypoints", "csv"))
        for words, path in (
            ("no such file", f"none.{suffix}"),
            ("a folder", "folder"),
            ("not a regular file", f"pipe.{suffix}"),
            ("link to itself", f"loop.{suffix}"),
        )
    ),
    (
        INPUT,
        "--set: metric_depth.options.path",
        f"{RUN} --set metric_depth.backend=file --set metric_depth.options.path=none.npy",
    ),
    (WEIGHTS, "none.npz", f"{RUN} --set body_model.path=none.npz"),
    (INPUT, "not a regular file", f"{RUN} --set body_model.path=pipe.npz"),
    (USAGE, "link to itself", "run a.png --config loop.toml"),
    (USAGE, "not a regular file", "config check --config pipe.toml"),
    (
        USAGE,
        "--stature: photo.stature: a stature should be 0.4 to 2.6 meters, or 0 where unknown "
        "(got 170; 170 cm are 1.7 meters)",
        f"{RUN} --stature 170",
    ),
    (USAGE, "15000 mm are 15 meters", f"{RUN} --camera-height 15000"),
    (USAGE, "5.8 ft are 1.77 meters", f"{SCENE} --stature 5.8"),
    (USAGE, "should be a list, such as [1.7, 1.8] (got '1,7')", f"{RUN} --set photo.stature=1,7"),
    (USAGE, "is not a number, such as 1200", f"{RUN} --focal-px 1200px"),
    (USAGE, "a comma separates people: write 1.7", f"{RUN} --stature 1,7"),
    (USAGE, "as --stature 1.7,1.8", f"{RUN} --stature 1.7 1.8"),
    (USAGE, "`physic batch", f"{RUN} b.png"),
    (USAGE, "KEY=VALUE", f"{RUN} --set photo.focal_px 900"),
    (USAGE, "Did you mean 'photo.focal_px'?", f"{RUN} --set focal_px=900"),
    (USAGE, "1.7 with a point", "run a.png --config comma.toml"),
    (USAGE, "there are: check", "plugins list"),
    (INPUT, "name photos", "batch folder -o many"),
    (USAGE, "--port", "serve --host 127.0.0.1:8000"),
    (USAGE, "is not a whole number", "serve --port abc"),
    (USAGE, "did you mean 'physic run a.png'", "a.png"),
    (USAGE, "write --to glb", "export result --format glb"),
    (USAGE, "--no-report", f"{RUN} --no-report --open"),
    (USAGE, "--focal-px and --intrinsics", f"{RUN} --focal-px 900 --intrinsics 1,2,3,4"),
    (USAGE, "--preset cannot be combined with --config", f"{RUN} --config x.toml"),
    (USAGE, "comma-separated numbers: fx,fy,cx,cy", f"{RUN} --intrinsics 1,2,3"),
    (USAGE, "'-o' / '--out': it is empty", f"{RUN} -o ''"),
    (USAGE, "Did you mean 'export'?", "exprot result"),
    (USAGE, "in single quotes", "run a.png --config windows.toml"),
    (INPUT, "CSV with commas", "batch semicolons.csv -o many --preset mock"),
    (INPUT, "CSV with commas", f"{RUN} --keypoints tabs.csv"),
    (INPUT, "save it so", f"{RUN} --keypoints utf16.csv"),
    (INPUT, "save it so", f"{SCENE} --cameras utf16.toml"),
    (INPUT, "write [NAME] for each camera", f"{SCENE} --cameras list.toml"),
    (USAGE, "save it so", "run a.png --config utf16.toml"),
    (USAGE, "name one, or a TOML file", "run a.png --config other.json"),
    (USAGE, "write --preset mock", "run a.png --config mock"),
    (USAGE, "takes options alone, such as --config FILE", "config show photo.age"),
    (USAGE, "takes A B", "compare a b c"),
    (USAGE, "there are: prox", "evaluate 3dpw"),
    (USAGE, "options follow the command", "--set run.threads=4 run a.png"),
    (USAGE, "physic plugins --interface inpainter", "plugins show inpainter"),
    (USAGE, "one command for each", "export result --to glb,usd"),
    (USAGE, "not a whole number", "export result --to glb --person 1-3"),
    (INPUT, "no such file", "export result --to glb --body-model none.npz"),
    (USAGE, "not a finite number", f"{RUN} --focal-px nan"),
    (USAGE, "--timeout", "plugins doctor mock --timeout -1"),
    (USAGE, "--cameras", f"{SCENE} --camera-unit 0.01"),
    (USAGE, "2 to 8 photos", "scene a.png --preset mock -o out"),
    (USAGE, "should not be true or false (got true)", f"{RUN} --set run.threads=true"),
    (
        USAGE,
        "photo.stature: should not be true or false (got [true])",
        f"{RUN} --set photo.stature=[true]",
    ),
    (
        USAGE,
        "metric_depth.options.noise: should not be true or false",
        f"{RUN} --set metric_depth.options.noise=false",
    ),
    (USAGE, "outside the upright photo of 160 x 120 px", f"{RUN} --person 999,9"),
    (USAGE, "is empty", f"{RUN} --box 90,90,10,10"),
    (USAGE, "focal length", f"{RUN} --focal-px 5"),
    (USAGE, "cpu, cuda or cuda:N", f"{RUN} --device gpu"),
    (USAGE, "choose one of", "export result --to glbb"),
    (USAGE, "does not end in .glb", "export result --to glb -o a.ply"),
    (USAGE, "there is no person 7", "export result --to glb --person 7"),
    (USAGE, "has no option 'rigid'", "export result --to ply --rigid"),
    (USAGE, "choose one of", "serve --preset mock --export fbx"),
    (INPUT, "no result in torn", "report torn"),
    (USAGE, "is not a folder", "setup paper --folder text.txt"),
]


@pytest.mark.parametrize(
    ("code", "words", "command"), MISTAKES, ids=[command for _, _, command in MISTAKES]
)
def test_a_mistake_is_one_message_with_the_code_of_its_kind(code, words, command, physic):
    if command.startswith("export"):
        save_reconstruction(empty_reconstruction(), "result", "numbers")
    done = physic(*shlex.split(command))
    assert (done.exit_code, words in done.stderr) == (code, True), done.output
    assert done.stderr.count("Error: ") == 1


def test_help_shows_no_bound_that_is_none():
    for words, command in commands():
        assert "None" not in command.get_help(click.Context(command)), words


@pytest.mark.parametrize("command", ["show", "report", "export --to depth", "compare result"])
def test_a_result_is_named_by_its_document_too(physic, command):
    save_reconstruction(empty_reconstruction(), "result", "numbers")
    done = physic(*shlex.split(command), "result/reconstruction.json")
    assert done.exit_code == 0, done.output
