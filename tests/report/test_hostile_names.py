"""Names that somebody gave regions, controls or methods are shown as they are: no tag, link or image comes of them."""

import json
from dataclasses import replace
from html.parser import HTMLParser

import matplotlib.figure
import mistune
import pytest
from bumpy_plate import bumpy_plate
from markdown_it import MarkdownIt
from nbconvert.filters.markdown_mistune import markdown2html_mistune

from replicate.base.paths import ROOT
from replicate.drawing.panels import Words, save_figure
from replicate.report import notebooks
from replicate.report.tables import Table, as_latex
from replicate.targets.figure10 import figure10

NAMES = (  # each has something that HTML, Markdown or a table's cell could take for its own
    "</td><script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "![x](https://example.org/x.png)",
    "[x](javascript:alert(1))",
    "&lt;script&gt;",
    "``<script>alert(1)</script>`",
    "`\\|<script>alert(1)</script>`",
    "a`<script>alert(1)</script>|`b`",
    "`a|b` <script>alert(1)</script> `c",
    "<!--",
    "**bold**",
    "C:\\<b>",
    "$\\x{$",
)
CODE = "`<script>alert(1)</script>`"  # it shows a tag, and is none
READERS = {
    "nbconvert": markdown2html_mistune,
    "mistune": mistune.create_markdown(escape=False, plugins=["table"]),
    "CommonMark": MarkdownIt("commonmark").enable("table").render,
}
OURS = {"p", "em", "strong", "b", "br", "table", "thead", "tbody", "tr", "th", "td", "code", "details", "summary"}


def allowed(name: str) -> set[str]:
    """Return the tags that a page may have: an address that stands in a name may become a link that shows itself."""
    return OURS | ({"a"} if "https:" in name else set())


class Page(HTMLParser):
    """What a browser finds in a page: its tags, and its text."""

    def __init__(self, page: str):
        super().__init__()
        self.tags: list[str] = []
        self.text = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.tags.append(tag)

    def handle_comment(self, data: str) -> None:
        self.tags.append("comment")

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture
def pages(monkeypatch):
    """Return a function that returns the pages that readers make of what a notebook shows when it is called."""
    shown: list = []
    monkeypatch.setattr("IPython.display.display", lambda *things, raw=False: shown.extend(things))

    def of(show, *arguments) -> list[Page]:
        shown.clear()
        show(*arguments)
        bundles = [
            thing if isinstance(thing, dict) else {"text/markdown": getattr(thing, "data", "")} for thing in shown
        ]
        texts = [bundle["text/markdown"] for bundle in bundles if isinstance(bundle["text/markdown"], str)]
        return [Page(reader(text)) for text in texts for reader in READERS.values()] + [
            Page(bundle["text/html"]) for bundle in bundles if "text/html" in bundle
        ]

    return of


@pytest.mark.parametrize("name", NAMES)
def test_a_caption_shows_a_name_and_takes_nothing_of_it_for_a_tag(pages, tmp_path, name):
    figure, words = matplotlib.figure.Figure((0.1, 0.1)), Words(name, f"The region {name}, by `make table2`.")
    save_figure(figure, tmp_path / "a.png", words)
    assert json.loads((tmp_path / "a.json").read_text()) == {"alt": name, "caption": words.caption}
    for found in (pages(notebooks.show, figure, words), pages(notebooks.show_picture, tmp_path / "a.png")):
        assert len(found) == len(READERS)
        for page in found:
            assert set(page.tags) <= allowed(name) and page.text.count("alert") == name.count("alert")
            assert "`" in name or page.text.strip() == f"The region {name}, by make table2."


@pytest.mark.parametrize("name", NAMES)
def test_a_table_shows_a_name_and_keeps_its_cells(pages, name):
    table = Table(f"Of {name}", (("", name, ""), ("", "mm", name)), ((name, "1", name),), (f"{name}: a note", CODE))
    found = pages(notebooks.show_table, table)
    assert len(found) == len(READERS) + 1
    for page in found:
        shown = 7 if page is not found[-1] else 6  # on a page one header spans two columns
        assert set(page.tags) <= allowed(name) and page.tags.count("td") == 3
        assert page.text.count("alert") == 1 + shown * name.count("alert")
        assert "`" in name or page.text.replace("\u00a0", " ").count(name) == shown


@pytest.mark.parametrize("name", NAMES)
def test_figure_10_names_a_hostile_region_in_its_caption(pages, name):
    record = bumpy_plate()
    named = replace(record, character=name, region_names=(name, *record.region_names[1:]))
    figure, words = figure10(named, across=24)
    assert name in words.caption
    for page in pages(notebooks.show, figure, words):
        assert set(page.tags) <= allowed(name)


def test_latex_takes_a_name_for_letters():
    text = as_latex(Table(r"\input{/etc/passwd}", (("", "~4 $x$ #1 a^b <c>"),), (("a", "1"),)))
    assert r"\caption{\textbackslash{}input\{/etc/passwd\}}" in text
    assert r"\textasciitilde{}4 \$x\$ \#1 a\textasciicircum{}b \textless{}c\textgreater{}" in text


def test_notebooks_show_words_by_the_report_alone_which_keeps_names_as_they_are():
    own = ROOT / "replicate" / "report" / "notebooks.py"
    sources = [file for folder in ("replicate", "data_recipes") for file in (ROOT / folder).rglob("*.py")]
    texts = {file: file.read_text("utf-8") for file in sources if file != own}
    for file in (ROOT / "notebooks").glob("*.ipynb"):
        cells = json.loads(file.read_text("utf-8"))["cells"]
        texts[file] = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    for file, text in texts.items():
        for way in ("IPython.display", "Markdown(", "HTML(", "text/markdown"):
            assert way not in text, f"{file} shows words by {way}"
