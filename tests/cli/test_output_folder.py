"""Where `physic run` writes: a folder of its own for each photo, and never over the user's
files.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from physic_core.cli import main
from physic_core.io.result_folder import file_digest, photo_identity_of_result

from .results import empty_reconstruction


@pytest.fixture(autouse=True)
def result_of_photo(pipeline):
    pipeline.result = lambda path: empty_reconstruction(photo=file_digest(path))


def photo(name):
    Path(name).parent.mkdir(exist_ok=True)
    Path(name).write_text(name)
    return name


def run(*arguments):
    saving = ("--save", "numbers")
    return CliRunner().invoke(main, ["run", "--preset", "mock", *saving, *arguments])


def folder_of(done):
    assert done.exit_code == 0, done.output
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("results: "))
    return line.removeprefix("results: ").partition("/")[0]


def test_the_folder_has_the_name_of_the_photo_and_is_taken_from_another_one_with_overwrite(
    pipeline,
):
    for _ in range(2):
        assert folder_of(run(photo("x/a.jpg"))) == "a-physic"
    done = run(photo("y/a.jpg"))
    assert (done.exit_code, "it holds the result of another photo" in done.stderr) == (2, True)
    assert len(pipeline.calls) == 2
    assert folder_of(run("y/a.jpg", "--overwrite")) == "a-physic"
    assert photo_identity_of_result("a-physic") == file_digest("y/a.jpg")


@pytest.mark.parametrize("overwrite", [(), ("--overwrite",)])
def test_a_folder_with_a_file_of_the_user_is_refused_before_the_run(pipeline, overwrite):
    photo("out/a.jpg")
    done = run("out/a.jpg", "-o", "out", *overwrite)
    assert (done.exit_code, "out: a.jpg there was not written by a run" in done.stderr) == (2, True)
    assert pipeline.calls == []
    assert Path("out/a.jpg").read_text() == "out/a.jpg"
    assert run("out/a.jpg", "-o", "new/below", "--set", "no.such=1").exit_code != 0
    assert not Path("new").exists()
