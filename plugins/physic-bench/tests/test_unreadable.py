"""Files without permission and empty folders: a reason per frame, or a refusal before anything is computed."""

from __future__ import annotations

from pathlib import Path

import pytest

from .miniatures import Files, run


@pytest.mark.parametrize("name", ["rich", "damon"])
def test_an_empty_folder_is_refused_with_a_list_of_what_is_missing(name: str, files: Files, tmp_path: Path):
    for folder in ("bodies/test", "Release_Datasets/damon"):
        (tmp_path / "set" / folder).mkdir(parents=True)
    done = run(name, str(tmp_path / "set"), "-o", str(tmp_path / "out"), "--preset", "mock", *files.arguments())
    assert done.exit_code != 0
    assert f"{tmp_path / 'set'} is not complete for '{name}'" in done.output
    assert not (tmp_path / "out").exists()
