"""What the command prints: nothing of others controls the terminal, and the end is the end."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from PIL import Image

from physic_batch.photo_processor import failed_row
from physic_core import load_reconstruction
from physic_core.cli import main
from physic_testing.worlds import load_world

from .results import empty_reconstruction

TITLE = "\x1b]0;OWNED\x07"  # sets the title of a terminal
SHOWN = r"\x1b]0;OWNED\x07"

pytestmark = [
    pytest.mark.usefixtures("few_steps"),
    pytest.mark.skipif(os.name != "posix", reason="elsewhere no file has such a name"),
]


def printed(*arguments, code=0):
    """What a command prints on both streams, in which nothing controls a terminal."""
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == code, done.output
    assert all(c.isprintable() or c in "\n\t" for c in done.output), ascii(done.output)
    return done.output


def process(*arguments, shell="", **environment):
    """Run ``python -m physic_core`` in a process of its own, with redirections of a shell."""
    words = [sys.executable, "-m", "physic_core", *arguments]
    command = ["sh", "-c", f'"$@" {shell}', "sh", *words]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env=os.environ | environment,
    )


def test_messages_of_plugins_are_printed_once_and_only_with_verbose(pipeline):
    root = logging.getLogger()
    before = root.level, list(root.handlers)

    def result(path):
        for name in ("one.onnx", "two.onnx", "two.onnx"):
            logging.getLogger("physic_mine").info("%s runs on CPU", name)
        logging.getLogger("somebody_else").info("net.onnx was read")
        return empty_reconstruction()

    pipeline.result = result
    Path("a.jpg").write_text("a")
    for options, shown in (((), 0), (("-v",), 1), (("-q",), 0)):
        words = ("run", "a.jpg", "--preset", "mock", "--save", "numbers", "--overwrite")
        text = printed(*words, *options)
        assert (text.count("one.onnx"), text.count("two.onnx runs on CPU")) == (shown, shown)
        assert "net.onnx" not in text
    assert (root.level, list(root.handlers)) == before


@pytest.mark.parametrize("options", [(), ("-v",), ("-q",)], ids=" ".join)
def test_a_run_escapes_names_and_texts(pipeline, options):
    def result(path):
        logging.getLogger("physic_mine").info("read %s", TITLE)
        return empty_reconstruction(notes=(f"note {TITLE}",), warnings=(f"warning {TITLE}",))

    pipeline.result = result
    name = f"a{TITLE}\x7f.jpg"
    Path(name).write_text("a")
    text = printed("run", name, "--preset", "mock", "--save", "numbers", *options)
    assert SHOWN in text


def test_the_error_of_an_argument_is_escaped():
    assert SHOWN in printed("run", "a.jpg", f"b{TITLE}.jpg", code=2)
    assert SHOWN in printed("run", f"a{TITLE}.jpg", "--preset", "mock", code=3)
    assert SHOWN in printed("plugins", f"show{TITLE}", code=2)


def test_a_batch_escapes_names(monkeypatch):
    def rows(items, job):
        return (failed_row(job, item, "InputError", TITLE, 0.0) for item in items)

    monkeypatch.setattr("physic_batch.run.open_executor", lambda *_: rows)
    Path("photos").mkdir()
    Path(f"photos/a{TITLE}.jpg").write_text("no photo")
    assert SHOWN in printed("batch", "photos", "-o", "out", "--preset", "mock")


def test_messages_and_logs_of_plugins_are_escaped(site):
    source = (
        f"import logging\nlogging.warning('warned %s', {TITLE!r})\nraise ValueError({TITLE!r})\n"
    )
    site.install("physic-odd", source)
    row = next(line for line in printed("plugins").splitlines() if "physic-odd" in line)
    assert f"ValueError: {SHOWN} (physic_odd.py:3)" in row
    # In this process pytest takes the log.
    site.install(
        "physic-other", source.replace("logging.warning", "logging.getLogger('mine').warning")
    )
    done = process("plugins", PYTHONPATH=str(site.folder), PYTHONSAFEPATH="1")
    assert f"warned {SHOWN}\n" in done.stderr
    assert TITLE not in done.stdout + done.stderr


def test_a_process_ends_with_its_exit_code_and_runs_its_exit_handlers(tmp_path, python):
    """The interpreter is not torn down, but functions of ``atexit`` are called, and lines in
    buffers are written.
    """
    start = (
        "import atexit, tempfile, sys\n"
        "from physic_core.cli.process import main_of_process\n"
        "sys.argv[0] = 'physic'\n"
        "class Last:\n"
        "    def __del__(self): print('torn down')\n"
        "last = Last()\n"
        "import physic_core.cli\n"
        "plain = physic_core.cli.main.invoke\n"
        "def invoke(ctx):\n"
        "    global folder\n"
        "    folder = tempfile.TemporaryDirectory(dir='.')\n"
        "    atexit.register(print, 'at exit')\n"
        "    return plain(ctx)\n"
        "physic_core.cli.main.invoke = invoke\n"
        "main_of_process()\n"
    )
    shown = python(start, "config", "show", "--preset", "mock").stdout
    assert shown.splitlines()[-1] == "at exit"
    assert "torn down" not in shown
    assert python(start, "show", "missing", ends=3).stdout == "at exit\n"
    assert python(start, "run", ends=2).stdout == "at exit\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("shell", ["2>/dev/full", "<&- >&- 2>&-"])
def test_a_run_whose_messages_nobody_can_read_writes_its_result(shell):
    Image.fromarray(load_world("stand", (160, 120)).image).save("walk.png")
    options = ["--save", "numbers", "--set", "engine.joint.optimiser.steps=1", "--no-cache"]
    done = process("run", "walk.png", "--preset", "mock", *options, shell=shell)
    assert (done.returncode, done.stderr) == (0, "")
    assert load_reconstruction("walk-physic").people
    assert ("usable for" in done.stdout) != (">&- 2" in shell)


def test_a_full_standard_output_is_one_line():
    done = process("plugins", shell=">/dev/full")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "cannot print" in done.stderr
