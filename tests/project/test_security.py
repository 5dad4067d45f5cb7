"""The statements of SECURITY.md, with the tests that hold each: one for each claim."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "SECURITY.md").read_text(encoding="utf-8")

CANNOT_RUN_CODE = {
    "a photo, a file of masks": (
        "tests/io/test_photo.py::test_other_formats_of_pillow_are_refused",
        "tests/io/test_photo.py::test_a_photo_of_too_many_pixels_is_refused",
        "tests/attacks/test_photo_bombs.py::test_no_image_takes_more_than_one_and_a_half_gigabytes",
    ),
    "a result folder (`Reconstruction.load`)": (
        "tests/io/test_results.py::test_a_pickle_in_the_arrays_is_not_opened",
        "tests/io/test_results.py::test_values_that_do_not_belong",
    ),
    "an SMPL-X, SMPL or MANO file": (
        "tests/body/test_smplx_file.py::test_a_smplx_file_is_read_without_unpickling",
        "tests/body/test_smpl_file.py::test_a_pickle_runs_nothing",
        "plugins/physic-human/tests/test_chumpy_free.py::test_a_file_that_would_run_code_is_refused",
    ),
    "a checkpoint of `physic-human` (`.pt`, `.ckpt`), without `trust_checkpoint`": (
        "plugins/physic-human/tests/test_hands.py::test_a_checkpoint_with_objects_is_read_only_if_trusted",
        "plugins/physic-human/tests/test_sam3d_body.py::test_a_checkpoint_with_objects_is_read_only_if_trusted",
    ),
    "the cache": (
        "tests/files/test_plain.py::test_a_pickle_is_never_opened",
        "plugins/physic-embedded/tests/test_kept_graphs.py::test_a_graph_that_others_could_write_is_not_opened",
        "tests/cache/test_claim.py::test_the_cache_of_another_user_is_not_used",
        "tests/cache/test_claim.py::test_a_folder_that_others_could_write_is_narrowed_and_emptied",
    ),
    "an upload to `physic serve`": (
        "plugins/physic-serve/tests/test_worker.py::test_a_photo_that_breaks_the_process_costs_itself_alone",
        "plugins/physic-serve/tests/test_app.py::test_the_name_of_the_file_is_shown_and_names_no_file",
    ),
    "a page of another site, while `physic serve` runs": (
        "plugins/physic-serve/tests/test_app.py::test_a_page_of_another_site_can_send_and_read_nothing",
    ),
    "`report.html`, made from names and results of others": (
        "plugins/physic-viewer/tests/test_report.py::test_only_the_scripts_of_the_page_may_run",
        "plugins/physic-viewer/tests/test_report.py::test_text_of_others_is_never_markup",
        "plugins/physic-viewer/tests/test_report.py::test_a_page_has_no_address_and_is_small",
    ),
    "a table of photos for `physic batch`": (
        "tests/batch/test_photos.py::test_a_table_with_faults_is_an_error",
        "tests/batch/test_photos.py::test_the_cells_of_a_photo_are_checked_as_settings",
        "tests/batch/test_photos.py::test_parquet_tables_of_pandas_have_nan_for_missing_values_and_numbers_as_ids",
    ),
    "text of others in messages": (
        "tests/cli/test_printing.py::test_a_run_escapes_names_and_texts",
        "tests/cli/test_printing.py::test_a_batch_escapes_names",
        "tests/cli/test_printing.py::test_messages_and_logs_of_plugins_are_escaped",
    ),
    "the current folder": (
        "tests/cli/test_current_folder.py::test_physic_imports_nothing_of_the_current_folder",
        "tests/discovery/test_local_modules.py::test_what_lies_beside_the_module_is_not_found",
    ),
}
WEIGHTS = {
    "A run downloads nothing.": "tests/project/test_no_network.py::test_a_test_that_uses_the_network_fails",
    "A downloaded file is compared": (
        "tests/weights/test_fetch.py::test_a_wrong_hash_is_said_and_the_file_removed",
        "tests/weights/test_fetch.py::test_a_file_of_another_size_is_removed",
        "tests/weights/test_manifest.py::test_a_fault_of_a_manifest_is_named",
    ),
    "`physic weights verify` repeats": (
        "tests/weights/test_command.py::test_verify_lists_what_differs_and_what_has_no_published_hash"
    ),
    "A run compares a weight file": (
        "tests/weights/test_verify.py::test_a_damaged_file_is_refused_and_not_missing",
        "tests/weights/test_verify.py::test_a_file_is_read_once_in_a_process_until_it_changes",
    ),
    "The embedded networks and the embedded body": (
        "plugins/physic-embedded/tests/test_weights.py::test_a_network_with_one_other_bit_is_refused",
        "plugins/physic-embedded/tests/test_weights.py::test_the_weights_that_were_compared_are_those_that_are_used",
        "plugins/physic-embedded/tests/test_kept_graphs.py::test_a_graph_that_others_could_write_is_not_opened",
        "tests/body/test_embedded.py::test_a_changed_asset_is_refused",
    ),
    "A file from a zip archive": "tests/weights/test_fetch.py::test_names_inside_a_zip_decide_no_place",
    "A weight set with a restricted licence": (
        "tests/weights/test_fetch.py::test_restricted_weights_are_fetched_only_with_accept_licence"
    ),
}
WRITTEN = {
    "Each file of a result": (
        "tests/attacks/test_saving.py::test_a_write_happens_completely_or_not_at_all",
        "tests/io/test_results.py::test_a_failing_write_leaves_the_former_result",
    ),
    "The files of a result belong together": (
        "tests/io/test_output.py::test_a_result_states_the_digest_of_each_file_but_its_own",
        "tests/attacks/test_saving.py::test_a_first_result_is_complete_or_not_there",
        "tests/attacks/test_saving.py::test_a_file_of_the_user_in_the_folder_of_a_killed_run_is_never_replaced",
        "tests/attacks/test_saving.py::test_a_page_that_is_interrupted_at_any_step_costs_no_result",
    ),
    "Files of the cache": (
        "tests/cache/test_claim.py::test_folders_and_files_are_for_their_user_alone_whatever_the_umask",
        "plugins/physic-embedded/tests/test_kept_graphs.py::test_a_graph_is_kept_for_its_user_alone",
    ),
    "A result without a row": "tests/batch/test_run.py::test_a_result_without_its_row_is_done_again",
    "A file of yours is never replaced": (
        "tests/io/test_output.py::test_every_foreign_file_is_named_at_once",
        "tests/io/test_output.py::test_saving_replaces_the_same_photos_result_alone",
        "tests/io/test_output.py::test_a_file_that_the_user_writes_while_pictures_are_made_is_kept",
        "tests/io/test_output.py::test_an_edited_file_and_a_link_are_kept_beside_the_new_one",
        "tests/batch/test_files_of_the_user.py::test_an_edited_file_of_a_result_is_kept",
        "tests/io/test_results.py::test_an_edited_document_is_read_and_replaced_as_the_runs_own",
    ),
    "`physic export --overwrite` replaces": (
        "plugins/physic-export/tests/test_request.py::test_a_file_is_replaced_only_where_that_is_wanted",
        "plugins/physic-export/tests/test_request.py::test_the_photo_and_links_are_never_replaced",
    ),
    "Tables, pages and logs": (
        "tests/batch/test_files_of_the_user.py::test_a_file_of_the_user_ends_the_batch_before_its_first_photo",
        "tests/batch/test_files_of_the_user.py::test_the_table_of_photos_is_never_replaced_by_the_table_of_results",
        "tests/files/test_own.py::test_everything_else_is_of_the_user",
        "tests/io/test_report_file.py::test_a_contact_sheet_of_the_user_ends_the_command_before_the_first_page",
        "plugins/physic-bench/tests/test_mistakes_of_users.py::test_a_file_of_the_user_is_never_replaced",
        "plugins/physic-scene/tests/test_moments.py::test_the_command_replaces_no_file_of_the_user",
    ),
    "No file of an output folder": (
        "tests/files/test_own.py::test_a_file_is_appended_to_and_a_link_is_not",
        "tests/io/test_output.py::test_an_edited_file_and_a_link_are_kept_beside_the_new_one",
        "tests/io/test_output.py::test_a_folder_that_is_a_link_is_written_to",
    ),
    "The photo is never replaced": (
        "tests/io/test_output.py::test_the_photo_is_never_overwritten",
        "tests/io/test_output.py::test_a_photo_that_is_a_file_of_its_folders_result_is_never_overwritten",
        "tests/io/test_output.py::test_no_photo_of_several_is_overwritten",
    ),
}
READ = {
    "a setting": "tests/configuration/test_bounds_of_settings.py::test_every_setting_is_bounded",
    "a photo, a file of masks": (
        "tests/io/test_photo.py::test_a_photo_of_too_many_pixels_is_refused",
        "tests/attacks/test_photo_bombs.py::test_decoding_takes_no_more_memory_than_estimated",
    ),
    "a photo, in a worker of `physic batch` or `physic serve`": (
        "tests/attacks/test_photo_bombs.py::test_a_worker_takes_no_more_memory_than_a_photo_needs"
    ),
    "a JPEG": (
        "tests/io/test_photo.py::test_a_jpeg_of_more_than_400_mb_is_refused",
        "tests/attacks/test_lost_data.py::test_the_number_of_scans_is_bounded",
    ),
    "arrays in a result, an archive or the cache": (
        "tests/files/test_npz.py::test_arrays_of_more_than_4_gb_are_refused_by_the_sizes_that_the_file_states",
        "tests/cache/test_damage.py::test_an_archive_that_claims_more_than_memory_is_not_unpacked",
    ),
}
LIMITS = {
    "`physic batch --timeout` ends a photo that takes longer, and a button of `physic serve` stops one": (
        "tests/attacks/test_hostile_backends.py::test_a_worker_that_hangs_is_ended_and_the_others_go_on",
        "plugins/physic-serve/tests/test_worker.py::test_a_photo_that_hangs_can_be_stopped",
    ),
}


def section(title: str) -> str:
    return re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S)[1]


def rows(title: str) -> list[str]:
    return [row.split(" | ")[0].removeprefix("| ") for row in re.findall(r"^\| .*", section(title), re.M)[1:]]


def test_every_statement_has_its_test():
    assert rows("What cannot run code") == list(CANNOT_RUN_CODE)
    assert rows("Limits of what is read") == list(READ)
    for title, tests in (("Files that PhySIC writes", WRITTEN), ("Weights", WEIGHTS)):
        points = re.findall(r"^- (.*)", section(title), re.M)
        assert [next(start for start in tests if point.startswith(start)) for point in points] == list(tests)
    assert all(statement in " ".join(section("Limits").split()) for statement in LIMITS)


@pytest.mark.parametrize(
    "tests", [tests for table in (CANNOT_RUN_CODE, WEIGHTS, WRITTEN, READ, LIMITS) for tests in table.values()]
)
def test_the_tests_of_a_statement_are_there(tests: str | tuple[str, ...]):
    for test in (tests,) if isinstance(tests, str) else tests:
        file, _, name = test.partition("::")
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8")


@pytest.mark.skipif(os.name != "posix", reason="elsewhere a current folder cannot be deleted")
def test_a_deleted_current_folder_is_one_message(tmp_path: Path):
    """In a process of its own, whose current folder it deletes."""
    code = "import os; os.rmdir(os.getcwd()); from physic_core.cli import main; main(['config', 'check'])"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.endswith("Error: the current folder does not exist or cannot be read: change to another one\n")


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--timeout", "inf"), "inf is not in the range 0<=x<=10000000."),
        (("--workers", "9999"), "9999 is not in the range 1<=x<=1024."),
    ],
)
def test_numbers_of_a_batch_are_bounded(options: tuple[str, str], reason: str, tmp_path: Path):
    from click.testing import CliRunner

    from physic_core.cli import main

    done = CliRunner().invoke(main, ["batch", "a.jpg", "-o", str(tmp_path), *options])
    assert done.exit_code == 2
    assert done.output.endswith(f"Invalid value for '{options[0]}': {reason}\n")


def test_a_message_cannot_control_a_terminal(tmp_path: Path):
    from click.testing import CliRunner

    from physic_core.cli import main

    done = CliRunner().invoke(main, ["run", str(tmp_path / "a\x1b[2Jb\u202ec.png"), "--preset", "mock"])
    assert done.exit_code == 3
    assert "a\\x1b[2Jb\\u202ec.png" in done.output
    assert "\x1b" not in done.output


def test_a_warning_cannot_control_a_terminal():
    """In a process of its own: where pytest has handlers of logs, warnings are left to them."""
    code = (
        "import warnings; from physic_core.cli.output import printed_logs\n"
        "with printed_logs(): warnings.warn('a\\x1b[2Jb')"
    )
    done = subprocess.run([sys.executable, "-W", "always", "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "<string>:2: UserWarning: a\\x1b[2Jb\n"
