"""A file is replaced only if it carries the mark of PhySIC, and never opened through a link."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from physic_core.errors import OutputError
from physic_core.files.atomic import MARK, check_own, open_to_append

LONG = "x" * 1_000_000


@pytest.mark.parametrize("text", [f"{MARK}{LONG}", f"{LONG}\n{MARK}\n", MARK])
def test_a_file_with_the_mark_at_an_end_may_be_replaced(tmp_path: Path, text: str):
    (tmp_path / "table.txt").write_text(text)
    check_own(tmp_path / "table.txt", tmp_path / "missing.txt")


@pytest.mark.parametrize(
    "make",
    [
        lambda path: path.write_text("mine"),
        lambda path: path.touch(),
        lambda path: path.write_text(f"{LONG}{MARK}{LONG}"),
        lambda path: path.mkdir(),
        lambda path: path.symlink_to("missing"),
        lambda path: path.symlink_to("own"),
    ],
    ids=["text", "empty", "middle", "folder", "link to nothing", "link to an own file"],
)
def test_everything_else_is_of_the_user(tmp_path: Path, make: Callable[[Path], None]):
    (tmp_path / "own").write_text(MARK)
    make(path := tmp_path / "table.txt")
    with pytest.raises(OutputError) as error:
        check_own(tmp_path / "own", path)
    assert str(error.value) == (
        f"cannot write {path}: a file that PhySIC did not write, or a link, is there; move it away, or name another "
        "folder"
    )


def test_a_file_is_appended_to_and_a_link_is_not(tmp_path: Path):
    for text in (b"a", b"b"):
        with open_to_append(tmp_path / "log") as file:
            file.write(text)
    (tmp_path / "link").symlink_to("log")
    with pytest.raises(OSError, match="it is a link"):
        open_to_append(tmp_path / "link")
    assert (tmp_path / "log").read_bytes() == b"ab"
