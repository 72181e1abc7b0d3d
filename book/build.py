"""Build the site of the notebooks, the pages of text and the programming interface: `make book`.

Everything is read from the project as it is: no notebook is executed, and nothing is fetched. The site opens from its
folder, without a server and without a network. How it looks is in conf.py beside this file.
"""

import argparse
import os
import shutil
import sys
import time
from pathlib import Path

from sphinx.cmd.build import build_main

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("replicate", "data_recipes")
PAGES = ("README", "RESULTS", "REPRODUCING", "ENGINES", "DEVIATIONS", "CONTRIBUTING", "CHANGELOG")
FOLDERS = (*PACKAGES, "book", "course", "examples", "notebooks", "results", "tests")
COPIED = (*(f"{page}.md" for page in PAGES), "CITATION.cff", "Dockerfile", "LICENSE", *FOLDERS)


def main() -> int:
    """Build the site, and say where it is; return 1 if Sphinx has anything to complain about."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--to", type=Path, default=ROOT / "build" / "book", help="the folder that gets the site")
    parser.add_argument("--rooms", nargs="+", help="only these pages of the interface, such as replicate.approximation")
    words = parser.parse_args()
    began, site = time.monotonic(), words.to.resolve() / "site"
    source = site.with_name("source")
    for folder in (source, site, read := site.with_name("read")):
        shutil.rmtree(folder, ignore_errors=True)
    stage(source, words.rooms)
    options = ["--quiet", "--fail-on-warning", "--keep-going", "--jobs", "auto", "-c", str(ROOT / "book")]
    if build_main([*options, "-d", str(read), str(source), str(site)]):
        print(f"{site}: the site lacks something; the warnings above say what", file=sys.stderr)
        return 1
    shutil.copyfile(site / "README.html", site / "index.html")
    for file in (ROOT / "results").glob("reference/**/manifest.json"):  # pages link to them in HTML of their own
        copy = site / file.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    print(f"The site is there, after {time.monotonic() - began:.0f} s. Open {site / 'index.html'} in a browser.")
    return 0


def stage(folder: Path, rooms: list[str] | None = None) -> None:
    """Lay out what the site is made from: copies of the project's files, and a page for each folder of modules.

    rooms: whose pages of the interface, by their names, if not all.
    """
    (folder / "api").mkdir(parents=True)
    left_out = shutil.ignore_patterns("__pycache__", ".ipynb_checkpoints", "runs")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=left_out)
        elif (ROOT / name).is_file():
            shutil.copyfile(ROOT / name, folder / name)
    for package in PACKAGES:
        folders = {".".join(file.parent.relative_to(ROOT).parts) for file in (ROOT / package).rglob("*.py")}
        names = sorted(name for name in folders - {package} if not rooms or name in rooms)
        for name in (package, *names):
            page = interface(name, names if name == package else [])
            (folder / "api" / f"{name}.rst").write_text(page, encoding="utf-8")
    examples = ["Examples", "========", ""]
    for file in sorted((ROOT / "examples").glob("*.py")):
        examples += [file.name, "-" * len(file.name), "", f".. literalinclude:: ../examples/{file.name}", ""]
    (folder / "api" / "examples.rst").write_text("\n".join(examples), encoding="utf-8")


def interface(name: str, parts: list[str]) -> str:
    """Return the page of a folder of modules: what it is about, its parts, and each module with what it offers."""
    lines = [name, "=" * len(name), "", f".. automodule:: {name}", "   :members:", ""]
    if parts:
        lines += [".. toctree::", "   :titlesonly:", "", *(f"   {part}" for part in parts), ""]
    for file in sorted(ROOT.joinpath(*name.split(".")).glob("[!_]*.py")):
        lines += [file.stem, "-" * len(file.stem), "", f".. automodule:: {name}.{file.stem}", "   :members:", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    sys.exit(main())
