"""Pictures of a result come from one installed plugin; where none makes them, the error names
metricbody-visual.
"""

from __future__ import annotations

import pytest

from physic_core import InputError, load_reconstruction, preview_png, save_reconstruction
from physic_core.errors import PackageMissingError, PluginError
from physic_core.io.report_file import add_report
from physic_core.pictures import PAGE_MARK, report_html

PAGE = """
from physic_core import PluginItem, hookimpl

@hookimpl
def physic_pictures():
    return [PluginItem("plain", "physic_page:pictures")]

def pictures(result, names, title):
    {body}
"""
PLAIN = (
    f"page = '{PAGE_MARK}<h1>' + title + '</h1>' + str(result)\n"
    "    return dict.fromkeys(names, page.encode())"
)


@pytest.fixture
def hidden(monkeypatch):
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-batch,metricbody-testing")


@pytest.fixture
def folder(make, tmp_path, monkeypatch):
    """The folder of a result, in the current one."""
    monkeypatch.chdir(tmp_path)
    save_reconstruction(make(people=0), tmp_path / "results" / "a", "numbers")
    return tmp_path / "results" / "a"


def install(site, body):
    site.install("physic-page", PAGE.format(body=body))


@pytest.mark.usefixtures("hidden")
def test_without_a_plugin_each_way_to_a_picture_names_it(make, folder, physic):
    result = make(people=0)
    for way in (
        lambda: report_html(result),
        lambda: preview_png(result),
        lambda: result.report("a.html"),
        lambda: add_report(folder),
    ):
        with pytest.raises(
            PackageMissingError, match="metricbody-visual, which is not installed, or hidden"
        ):
            way()
    for arguments in ((folder,), (folder, "-o", "a.html"), ("--each", folder.parent)):
        done = physic("report", *arguments)
        assert (done.exit_code, done.stdout, "metricbody-visual" in done.stderr) == (4, "", True)
    assert sorted(path.name for path in folder.iterdir()) == [
        "reconstruction.json",
        "reconstruction.npz",
    ]


@pytest.mark.usefixtures("hidden")
def test_without_a_plugin_pictures_are_refused_and_the_numbers_kept(make, tmp_path):
    with pytest.raises(PackageMissingError, match="metricbody-visual, which is not installed"):
        make(people=0).save(str(tmp_path / "a"))
    assert {path.name for path in (tmp_path / "a").iterdir()} == {
        "reconstruction.json",
        "reconstruction.npz",
    }
    load_reconstruction(tmp_path / "a")


@pytest.mark.usefixtures("hidden")
def test_a_contact_sheet_needs_no_maker_of_pictures(folder, physic):
    done = physic("report", "results")
    assert (done.exit_code, done.stdout) == (0, "wrote results/contact-sheet.html\n")


def test_the_page_of_another_plugin_is_written(folder, site, monkeypatch, physic):
    install(site, PLAIN)
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-batch,physic-page")
    assert physic("report", folder, "--title", "mine").exit_code == 0
    assert (
        (folder / "report.html")
        .read_text()
        .startswith(f"{PAGE_MARK}<h1>mine</h1>Reconstruction(0 people, 160 x 120, ")
    )
    (folder / "reconstruction.npz").write_bytes(b"PK")
    with pytest.raises(InputError) as error:
        add_report(folder)
    assert (folder / "report.html").read_text() == f"{PAGE_MARK}<h1>a</h1>{error.value}"


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return None", "bytes of report.html, got 'None'"),
        ("return {}", "bytes of report.html, got 'None'"),
        (
            f"return {{names[0]: (500 * ' ' + '{PAGE_MARK}').encode()}}",
            "in its first 500 bytes, got",
        ),
        ("return title / 2", "fails: TypeError"),
    ],
    ids=["nothing", "no page", "no generator", "fails"],
)
def test_a_page_that_breaks_the_contract_is_refused(make, site, monkeypatch, body, words):
    install(site, body)
    monkeypatch.setenv("PHYSIC_PLUGINS", "physic-page")
    with pytest.raises(PluginError, match=f"'plain' of physic-page 1.0 .*{words}"):
        report_html(make(people=0))
