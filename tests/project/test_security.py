"""The statements of SECURITY.md, each with the tests that hold it."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "SECURITY.md").read_text(encoding="utf-8")

TABLES = {
    "What cannot run code": {
        "a photo": "test_an_unusable_file_is_refused_with_its_path_and_the_reason",
        "a result folder (`Reconstruction.load`)": "test_a_pickle_in_the_arrays_is_not_opened",
        "an SMPL-X, SMPL or MANO file": "test_no_pickle_calls_anything "
        "test_a_smplx_file_is_read_without_unpickling",
        "a checkpoint of `metricbody-paper` (`.pt`, `.ckpt`), without "
        "`trust_checkpoint`": "is_read_only_if_trusted",
        "the cache": "test_a_pickle_is_never_opened "
        "test_a_graph_that_others_could_write_is_not_opened",
        "an upload to `physic serve`": "test_a_photo_that_breaks_the_process_costs_itself_alone",
        "a page of another site, while "
        "`physic serve` runs": "test_a_page_of_another_site_can_send_and_read_nothing",
        "`report.html`, made from names and "
        "results of others": "test_only_the_scripts_of_the_page_may_run",
        "a table of photos for `physic batch`": "test_a_table_with_faults_is_an_error",
        "a file of cameras, keypoints or depth of another "
        "program": "test_what_is_not_supported_or_damaged_is_named "
        "test_what_an_archive_calls_not_valid_is_unknown",
        "text of others in messages": "test_a_run_escapes_names_and_texts "
        "test_a_batch_escapes_names",
        "the current folder": "test_physic_imports_nothing_of_the_current_folder",
    },
    "Limits of what is read": {
        "a setting": "test_every_option_is_bounded",
        "a file that an argument or a "
        "setting names": "test_a_mistake_is_one_message_with_the_code_of_its_kind",
        "a photo": "test_decoding_the_largest_image_of_each_format",
        "a photo, in a worker of `physic batch` or "
        "`physic serve`": "test_a_worker_takes_no_more_memory",
        "a JPEG": "test_the_number_of_scans_is_bounded",
        "arrays in a result, an archive or the cache": "test_arrays_of_more_than_4_gb_are_refused",
        "a color profile; a thumbnail of a batch": "test_a_profile_of_more_than_8_mb_is_not_read "
        "test_a_sheet_embeds_only_what_decodes_as_a_jpeg",
        "TOML and JSON": "test_values_nested_too_deep_are_one_sentence",
        "a message": "test_a_message_is_short_and_has_no_addresses",
    },
}
LISTS = {
    "Weights": {
        "A run downloads nothing.": "test_a_test_that_uses_the_network_fails",
        "A run sends nothing": "test_a_script_with_a_strangers_network_leaves_home_empty",
        "A downloaded file that differs": "test_a_file_that_differs_from_the_manifest_is_removed "
        "test_verify_lists_what_differs_and_what_has_no_published_hash",
        "A run refuses a weight file": "test_a_damaged_file_is_refused_and_not_missing",
        "The embedded networks and the "
        "embedded body": "test_a_network_with_one_other_bit test_a_changed_asset",
        "A weight set with a "
        "restricted license": "test_restricted_weights_are_fetched_only_with_accept_license",
    },
    "Files that PhySIC writes": {
        "Each file is written": "test_an_interruption_loses_nothing_and_is_no_success",
        "A result folder is": "test_the_hidden_result_of_a_killed_process "
        "test_two_writers_without_a_common_lock",
        "Commands that read a result": "test_a_name_that_leads_out_of_the_folder_is_no_file",
        "A file that a document": "test_a_name_that_leads_out_of_the_folder_is_no_file "
        "test_a_sheet_neither_embeds_nor_links_what_lies_outside",
        "No file is read or written": "test_a_result_whose_file_is_a_link_that_leads_out "
        "test_a_batch_writes_nothing_through_a_link_that_leads_out",
        "Arrays of a result are refused": "test_arrays_that_were_changed_after_the_run_are_refused",
        "Only you can read": "test_folders_and_files_are_for_their_user_alone_whatever_the_umask",
        "A file of yours is never replaced": "test_a_foreign_or_edited_file_is_named_and_stays",
        "`physic export --overwrite` replaces": "test_the_photo_and_links_are_never_replaced",
        "Tables, pages and logs": "test_a_file_of_the_user_ends_the_batch_before_its_first_photo",
        "The photo is never replaced": "test_the_photo_is_never_replaced",
    },
}
LIMITS = {
    "`physic batch --timeout` ends a photo": "test_a_worker_that_hangs",
    "a button of": "test_a_photo_that_hangs",
}


def section(title):
    return re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S)[1]


def test_every_statement_has_its_tests():
    for title, tests in TABLES.items():
        rows = re.findall(r"^\| (.*?) \| ", section(title), re.M)
        assert rows[1:] == list(tests)
    for title, tests in LISTS.items():
        points = re.findall(r"^- (.*)", section(title), re.M)
        assert [
            next(start for start in tests if point.startswith(start)) for point in points
        ] == list(tests)
    assert all(statement in " ".join(section("Limits").split()) for statement in LIMITS)


@cache
def names_of_tests():
    files = (*ROOT.glob("tests/**/test_*.py"), *ROOT.glob("plugins/*/tests/**/test_*.py"))
    return "\n".join(
        name for file in files for name in re.findall(r"def (test_\w+)", file.read_text("utf-8"))
    )


@pytest.mark.parametrize(
    "tests",
    [tests for one in (*TABLES.values(), *LISTS.values(), LIMITS) for tests in one.values()],
)
def test_the_tests_of_a_statement_are_there(tests):
    assert all(test in names_of_tests() for test in tests.split())


def test_a_warning_cannot_control_a_terminal(python):
    """In a process of its own: where pytest has handlers of logs, warnings are left to them."""
    code = (
        "import warnings; from physic_core.cli.output import printed_logs\n"
        "with printed_logs(): warnings.warn('a\\x1b[2Jb')"
    )
    shown = python(code, PYTHONWARNINGS="always").stderr
    assert shown == "<string>:2: UserWarning: a\\x1b[2Jb\n"
