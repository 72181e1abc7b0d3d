"""How the site of `make book` looks: Sphinx with myst-nb and the theme Furo, all of it local."""

import json
import os
import re
import sys
import textwrap
import tomllib
from pathlib import Path

from docutils import nodes
from docutils.utils.math import latex2mathml

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

# The navigation: captions, and under each its pages.
NAVIGATION = {
    "": ("RESULTS", "REPRODUCING", "ENGINES", "DEVIATIONS", "CONTRIBUTING", "CHANGELOG"),
    "A course": ("course/README", "course/LECTURERS"),
    "Notebooks": ("notebooks/README",),  # whose own list is the order of reading
    "Rigs and files": ("data_recipes/README", "results/README"),
    "Programming interface": ("api/replicate", "api/data_recipes", "api/examples"),
}

project = "Fast and Deep Facial Deformations, replicated"
version = release = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
author = "The authors of this replication"
language = "en"
extensions = ["myst_nb", "sphinx.ext.autodoc"]
root_doc = "README"
COURSE = ["course/*.md", "course/**/*.md", "course/**/*.ipynb"]
include_patterns = ["*.md", "api/*.rst", *COURSE, "data_recipes/README.md", "notebooks/*", "results/README.md"]

nb_execution_mode = "off"
nb_render_markdown_format = "myst"
nb_code_prompt_show, nb_code_prompt_hide = "Code", "Hide the code"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
suppress_warnings = ["config.cache", "ref.python", "toc.not_included"]

autodoc_default_options = {"ignore-module-all": True, "member-order": "bysource"}
autodoc_mock_imports = ["bpy", "maya", "mediapipe"]
autodoc_inherit_docstrings = False
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90
add_module_names = False
toc_object_entries = False

html_theme = "furo"
html_title = f"Facial deformations {release}"
html_theme_options = {"navigation_with_keys": True}
html_static_path = ["static"]
html_css_files = ["book.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_copyright = html_show_sphinx = False
html_show_search_summary = False  # it would be read from other pages, which a browser refuses where there is no server


def complete(app, page, source):
    """Give pages their place in the navigation, and make reports of notebooks, whose code opens by a click."""
    if page == root_doc:
        source[0] += "".join(_contents(app, names, caption) for caption, names in NAVIGATION.items())
    elif page == "notebooks/README":
        names = dict.fromkeys(re.findall(r"\]\((\w+)\.ipynb\)", source[0]))
        source[0] += _contents(app, [f"notebooks/{name}" for name in names])
    elif page == "course/README":
        source[0] += _contents(app, [*_pages(app, "course/student/"), *_pages(app, "course/project/")])
    elif page == "course/LECTURERS":
        source[0] += _contents(app, [*_pages(app, "course/notes/"), *_pages(app, "course/solutions/")])
    if (Path(app.srcdir) / f"{page}.ipynb").is_file():
        notebook = json.loads(source[0])
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code" and page.startswith("notebooks/"):  # of a lesson the code is the point
                cell["metadata"].setdefault("tags", []).append("hide-input")
            elif cell["cell_type"] == "markdown":
                cell["source"] = _linked(app, page, re.sub(r"\]\(#(.*?)\)", _anchor, "".join(cell["source"])))
        source[0] = json.dumps(notebook)
    else:
        source[0] = _linked(app, page, source[0])


def _anchor(match):
    """Return a link to a heading of a notebook, which Jupyter calls Does-it-fit?, as pages call it: does-it-fit."""
    return f"](#{re.sub('[^a-z0-9-]', '', match[1].lower())})"


def _linked(app, page, text):
    """Return a page's text with links to code leading to its page of the interface, and none to folders."""

    def link(match):
        words, place = match.groups()
        path = Path(os.path.normpath(Path(page).parent / place))
        code = f"api/{'.'.join(path.parent.parts)}"
        if path.suffix == ".py" and code in app.env.found_docs:
            return f"{words}(/{code}.rst)"
        return words if (Path(app.srcdir) / path).is_dir() else match[0]

    return re.sub(r"(\[[^]]*\])\(([^():#\s]+)\)", link, text)


def _pages(app, folder):
    """Return the names of a folder's pages, in order."""
    return [name for name in sorted(app.env.found_docs) if name.startswith(folder)]


def _contents(app, names, caption=""):
    """Return a table of contents that shows in the navigation alone; names of pages that aren't there are left out."""
    there = [f"/{name}" for name in names if name in app.env.found_docs and name != app.env.docname]
    caption = [f":caption: {caption}"] if caption else []
    return "\n".join(["", "```{toctree}", ":hidden:", *caption, "", *there, "```", ""]) if there else ""


def as_rest(app, what, name, object_, options, lines):
    """Turn a docstring of the project into reStructuredText: `code`, what is aligned by spaces, an argument a line."""
    result = []
    for paragraph in "\n".join(lines).removesuffix("\n").split("\n\n"):
        if paragraph.startswith("Attributes:\n"):
            paragraph = textwrap.dedent(paragraph.partition("\n")[2])
        rows = paragraph.split("\n")
        if any(re.search(r"\S {3,}\S|─", row) for row in rows) or rows[0].startswith("    "):
            result += ["::", "", *(f"    {row}" for row in rows), ""]
            continue
        argument = False
        for row in rows:
            names, colon, text = row.partition(": ")
            if colon and re.fullmatch(r"\*{0,2}[a-z_]\w*(, \*{0,2}[a-z_]\w*)*", names):
                result += [*([] if argument else [""]), f"``{names}``", f"    {_escaped(text)}"]
                argument = True
            else:
                result.append(f"    {_escaped(row.strip())}" if argument else _escaped(row))
        result.append("")
    lines[:] = result


def _escaped(text):
    """Return a line with its `code` and *emphasis* as reStructuredText writes them, and no other marks."""
    pieces = re.split(r"`([^`]+)`", text)
    pieces[::2] = [re.sub(r"([\\*_|`])", r"\\\1", piece) for piece in pieces[::2]]
    pieces[::2] = [re.sub(r"(?<!\w)\\\*(\w(?:[^*]*\w)?)\\\*(?!\w)", r"*\1*", piece) for piece in pieces[::2]]
    pieces[1::2] = [rf"\ ``{piece}``\ " for piece in pieces[1::2]]
    return "".join(pieces)


def mathml(block):
    """Return how formulas are written into pages: as MathML, which browsers draw themselves."""

    def write(translator, node):
        tex = node.astext().replace(r"\dots", r"\ldots")  # which docutils doesn't know
        translator.body.append(latex2mathml.tex2mathml(tex, as_block=block))
        raise nodes.SkipNode

    return write, None


def setup(app):
    app.connect("source-read", complete)
    app.connect("autodoc-process-docstring", as_rest)
    app.add_html_math_renderer("mathml", mathml(False), mathml(True))
