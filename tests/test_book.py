"""The site of `make book`, in a real browser: every page of it, opened from disk."""

import re
import subprocess
import sys
from urllib.parse import unquote, urlsplit

import pytest
from browser import Tab

from replicate.base.paths import ROOT

ROOM = "replicate.approximation"  # the interface has thirty pages more, which take most of the time
FACTS = """({
    links: [...document.links].map(link => link.href),
    ids: [...document.querySelectorAll("[id]")].map(element => element.id),
    broken: [...document.images].filter(picture => !picture.naturalWidth).map(picture => picture.src),
    width: document.documentElement.scrollWidth,
})"""


class Reader(Tab):
    """A browser that also notes what a page reports as an error, say a file that it lacks."""

    def start(self):
        super().start()
        self.call("Log.enable")

    def notice(self, message):
        super().notice(message)
        entry = message.get("params", {}).get("entry", {})
        if message.get("method") == "Log.entryAdded" and entry["level"] == "error":
            self.errors.append(entry)

    def visit(self, address):
        self.open(address, f"location.href == {address!r} && document.readyState == 'complete'")
        return self.evaluate(FACTS)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site of all notebooks and pages, and of one room's modules."""
    folder = tmp_path_factory.mktemp("book")
    command = [sys.executable, str(ROOT / "book" / "build.py"), "--to", str(folder), "--rooms", ROOM]
    process = subprocess.run(command, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    assert str(folder / "site" / "index.html") in process.stdout and not process.stderr
    return folder / "site"


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    with Reader(tmp_path_factory.mktemp("reader")) as tab:
        yield tab


def test_all_pages_of_the_site_are_whole_and_need_no_other_machine(site, reader):
    pages = {page.as_uri(): page for page in sorted(site.rglob("*.html"))}
    assert len(pages) > 35 and {f"{path.stem}.html" for path in (ROOT / "notebooks").glob("*.ipynb")} <= {
        page.name for page in pages.values()
    }
    seen = {address: reader.visit(address) for address in pages}
    assert not reader.errors
    assert not [address for address in reader.requests if urlsplit(address).scheme not in ("file", "data")]
    for address, facts in seen.items():
        assert not facts["broken"], address
        for link in facts["links"]:
            scheme, _, path, _, fragment = urlsplit(link)
            if scheme == "file":
                target = link.partition("#")[0].partition("?")[0]
                assert target in seen or ROOT.joinpath(unquote(path)).is_file(), f"{address}: {link}"
                ids = seen.get(target, {"ids": []})["ids"]
                assert not fragment or unquote(fragment) in ids, f"{address}: {link}"


def test_the_site_fits_a_telephone(site, reader):
    reader.call("Emulation.setDeviceMetricsOverride", width=420, height=800, deviceScaleFactor=1, mobile=True)
    for name in ("index", "notebooks/table2", "notebooks/rig_tour", f"api/{ROOM}", "REPRODUCING"):
        assert reader.visit((site / f"{name}.html").as_uri())["width"] <= 420, name
    reader.call("Emulation.clearDeviceMetricsOverride")


def test_the_site_is_searched_without_a_server(site, reader):
    reader.visit(f"{(site / 'search.html').as_uri()}?q=forehead")
    reader.wait("document.querySelectorAll('#search-results li a').length > 1")
    found = reader.evaluate("[...document.querySelectorAll('#search-results li a')].map(link => link.href)")
    assert any("notebooks/figure09.html" in address for address in found) and not reader.errors


def test_a_notebook_of_the_site_has_its_tables_pictures_formulas_and_folded_code(site):
    text = (site / "notebooks" / "table2.html").read_text("utf-8")
    assert text.count("<table") > 6 and text.count('<img alt="') > 4 and "<math" in text
    assert text.count('<details class="admonition hide above-input">') == text.count('class="cell_input ') > 10


def test_a_page_of_the_interface_has_every_module_with_its_shapes_and_arguments(site):
    text = re.sub("<[^>]+>", "", (site / "api" / f"{ROOM}.html").read_text("utf-8"))
    modules = [path.stem for path in (ROOT / ROOM.replace(".", "/")).glob("[a-z]*.py")]
    assert all(f"\n{name}" in text for name in modules)
    assert "Float[ndarray, 'k 2']" in text and "Return where texture coordinates in [0, 1] lie between" in text
