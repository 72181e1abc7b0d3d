"""Execute the notebooks: on the reference results that they are committed with, or on a run of yours, into a new file.

`python -m replicate.report.notebooks table2 laptop` executes notebooks/table2.ipynb on results/runs/laptop and writes
results/runs/laptop/table2.ipynb. With "reference" the committed notebook itself is refreshed.
"""

import argparse
import hashlib
import html
import json
import os
import re
import sys
import textwrap
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.base.code_hash import code_digest
from replicate.base.command_line import guard
from replicate.base.exceptions import InputError, RunError
from replicate.base.files import short_temporary_folder, write_text
from replicate.base.paths import PAPER, REFERENCE, ROOT, committed_folders, display_path, run_folder
from replicate.drawing.panels import WEBP, Words, for_page, png
from replicate.engine.provenance import LABELS, as_lines
from replicate.report.manifest import DRAWN, POSES, command_of, section, targets
from replicate.report.manifest import NAME as MANIFEST
from replicate.report.results import Row, order_of, read_results
from replicate.report.tables import Table, as_html, as_markdown, plain_markdown, unbroken

if TYPE_CHECKING:
    import matplotlib.figure


NOTEBOOKS = ROOT / "notebooks"
TIMEOUT_S = 600
WIDGET = "application/vnd.jupyter.widget-view+json"
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def folder_of(name: str) -> Path:
    """Return the folder of the committed results of a name, "reference", or of your run with that profile."""
    return committed_folders().get(name) or run_folder(name)


def open_table(name: str, target: str) -> list[Row]:
    """Read the rows of another table, "table1", from `folder_of(name)`. Raises InputError if there is none."""
    file = folder_of(name) / f"{target}.csv"
    if not file.is_file():
        raise InputError(f"{file}: there is no such results file; `make {command_of(target)}` writes it.")
    return read_results(file)


def published_table(target: str) -> list[Row]:
    """Read the paper's own rows of a table, "table1"."""
    return read_results(PAPER / f"{target}.csv")


def rows_if_there(name: str, file: str) -> list[Row]:
    """Read the rows of another file, "rig_report.csv", from `folder_of(name)`; none if it is missing."""
    path = folder_of(name) / file
    return read_results(path) if path.is_file() else []


def figure_files(name: str, target: str, needed: bool = True) -> dict[str, list[Path]]:
    """Return, by character, the pictures of a figure, "figure05" …, that the manifest in `folder_of(name)` names.

    needed: False for a figure that a run may lack. Raises InputError, with the command that draws them, if there are
    none or one is missing.
    """
    folder = folder_of(name)
    if not needed and target not in targets(folder):
        return {}
    pictures = {}
    for character, facts in section(folder, target).get("characters", {}).items():
        pictures[character] = [folder / file for file in facts.get("files", ()) if file.endswith((".png", WEBP))]
        missing = [file for file in pictures[character] if not file.is_file()]
        if missing:
            raise InputError(f"{missing[0]}: there is no such picture; `make {command_of(target)}` draws it.")
    return dict(sorted(pictures.items(), key=lambda item: order_of(item[0])))


def pick(there: Iterable[Row | str], wanted: str) -> str:
    """Return the character that a notebook's first cell names where there are results of it, else the first of them.

    there: rows, or names of characters.
    """
    names = {each.character if isinstance(each, Row) else each for each in there}
    return wanted if wanted in names or not names else min(names, key=order_of)


def whole_rigs(rows: Iterable[Row]) -> list[Row]:
    """Return the rows without those of a character's variants, such as teen@one_face; all where there are no others."""
    rows = list(rows)
    return [row for row in rows if "@" not in row.character] or rows


def show_table(table: Table, folded: bool = False) -> None:
    """Show a table in a notebook: as HTML, and as Markdown where no HTML is shown, as in a PDF.

    folded: show the title alone until a reader clicks it.
    """
    from IPython.display import display

    display({"text/html": as_html(table, folded), "text/markdown": unbroken(as_markdown(table))}, raw=True)


def show_tables(tables: Iterable[Table | None]) -> None:
    """Show tables of one kind, say one for each character: the first as it is, the others folded; None is skipped.

    Notes of the first table are not repeated.
    """
    first, *others = [table for table in tables if table] or [None]
    if first:
        show_table(first)
    for table in others:
        notes = tuple(note for note in table.notes if note not in first.notes)
        show_table(replace(table, notes=notes), folded=True)


def show(figure: "matplotlib.figure.Figure", words: Words) -> None:
    """Show a figure in a notebook with its alt text and caption."""
    _show(png(figure, words), words)


def _show(data: bytes, words: Words, width: int | None = None) -> None:
    from IPython.display import Image, Markdown, display

    display(Image(for_page(data), alt=words.alt, width=width), Markdown(f"*{plain_markdown(words.caption)}*"))


def show_text(text: str) -> None:
    """Show a text of ours in a notebook, as Markdown."""
    from IPython.display import Markdown, display

    display(Markdown(text))


def show_folded(summary: str, lines: Iterable[str]) -> None:
    """Show one line of plain text in a notebook, and further ones once a reader clicks it.

    Where no HTML is shown, as in a PDF, the lines are left out.
    """
    from IPython.display import display

    body = "\n".join(f"<li>{html.escape(line, quote=False)}</li>" for line in lines)
    whole = f"<details><summary>{html.escape(summary, quote=False)}</summary>\n<ul>\n{body}\n</ul>\n</details>"
    display({"text/html": whole, "text/markdown": plain_markdown(f"{summary}: see the page itself.")}, raw=True)


def show_picture(file: Path, width: int | None = None) -> None:
    """Show a saved figure in a notebook with its alt text and caption, which are in a JSON file beside it.

    file: may lack its ending: a run's pictures are PNG, the committed ones WebP
    width: of the picture on the page, px; by default as wide as it is, or as the page.
    """
    if not file.suffix:
        file = next((there for ending in (".png", WEBP) if (there := file.with_suffix(ending)).is_file()), file)
    _show(file.read_bytes(), Words(**json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))), width)


def execute(source: Path, out: Path, parameters: dict[str, object], stamp: str | None = None) -> None:
    """Execute a notebook with other values for its parameters, and write it, byte for byte the same each time.

    What cells write to stderr goes to ours. Raises InputError if a cell does, RunError if the kernel dies, and what
    nbclient raises for a cell that fails otherwise; `out` then stays as it was.

    parameters: name → value; each name must be assigned in the first code cell
    stamp: stored in the metadata
    """
    sys.modules.setdefault("rfc3987_syntax", None)  # jsonschema has it build a grammar of addresses, 2 s: none is here
    import nbformat
    from jupyter_client.manager import AsyncKernelManager
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError, DeadKernelError

    # the notebook with its parameters and without outputs
    notebook = nbformat.read(source, as_version=4)
    first = next(cell for cell in notebook.cells if cell.cell_type == "code")
    first.source = with_parameters(first.source, parameters)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    # a kernel that reads and writes no settings of the user's
    with short_temporary_folder() as folder:
        sockets = {"transport": "ipc", "ip": f"{folder}/kernel", "connection_file": f"{folder}/kernel.json"}
        client = NotebookClient(
            notebook,
            km=AsyncKernelManager(kernel_name="python3", **sockets),
            timeout=TIMEOUT_S,
            record_timing=False,
            resources={"metadata": {"path": str(NOTEBOOKS)}},
        )
        places = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        environment = os.environ | {
            "PYTHONPATH": places,
            "IPYTHONDIR": str(folder),
            "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        }
        try:
            client.execute(env=environment, cleanup_kc=True)
        except CellExecutionError as error:
            if error.ename == InputError.__name__:  # one sentence, not a kernel's traceback
                raise InputError(error.evalue) from None
            raise
        except DeadKernelError:
            raise RunError(
                f"{source}: its kernel was killed, probably because memory ran out; run the same command again"
            ) from None
    # the same bytes each time
    notebook.metadata = nbformat.from_dict(METADATA | ({"replicate": {"stamp": stamp}} if stamp else {}))
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = _stable(cell.outputs)
    write_text(out, nbformat.writes(notebook, version=4).rstrip("\n") + "\n")


def with_parameters(source: str, parameters: dict[str, object]) -> str:
    """Return a cell's source with other values assigned to some names; comments after them stay."""
    lines = source.split("\n")
    for name, value in parameters.items():
        places = [k for k, line in enumerate(lines) if line.startswith(f"{name} = ")]
        if len(places) != 1:
            raise InputError(f"expected the notebook's first code to assign {name} once, got {len(places)} times.")
        _, hash_, comment = lines[places[0]].partition("  # ")
        lines[places[0]] = f"{name} = {json.dumps(value)}{hash_}{comment}"
    return "\n".join(lines)


def _stable(outputs: list) -> list:
    """Join pieces of printed text, pass stderr on to ours, and leave widgets out, so that outputs repeat exactly."""
    merged: list = []
    for output in outputs:
        if output.output_type == "stream" and output.name == "stderr":
            sys.stderr.write(output.text)
        elif output.output_type == "stream" and merged and merged[-1].output_type == "stream":
            merged[-1].text += output.text
        elif WIDGET in output.get("data", {}):
            continue  # a widget's name changes each time, and it shows nothing without a kernel
        else:
            merged.append(output)
    return merged


def run_notebook(name: str, results: str, **parameters: object) -> Path:
    """Execute one of the notebooks on some results, unless that was done already, and return its file.

    results: "reference", or the profile of a run. parameters: more values for the first code cell.
    """
    source = NOTEBOOKS / f"{name}.ipynb"
    if not source.is_file():
        choices = ", ".join(sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb")))
        raise InputError(f"{source}: there is no such notebook; there are {choices}.")
    if results == "reference":
        execute(source, source, {"RESULTS": results, **parameters})
        return source
    out = folder_of(results) / source.name
    if not is_current(name, results, **parameters):
        execute(source, out, {"RESULTS": results, **parameters}, _stamp(source, out.parent, parameters))
    return out


def is_current(name: str, results: str, **parameters: object) -> bool:
    """Return whether `run_notebook` was done on these results of yours as they are now."""
    source, out = NOTEBOOKS / f"{name}.ipynb", folder_of(results) / f"{name}.ipynb"
    stamp = _stamp(source, out.parent, parameters)
    return out.is_file() and stamp in out.read_text(encoding="utf-8", errors="replace")


def _stamp(source: Path, folder: Path, parameters: dict) -> str:
    """Return a hash of all that a notebook's outputs depend on: its cells, the code that they reach, and the results.

    These are the folder's files that begin with the notebook's name, the CSV files that its cells name, there and among
    the committed results, and its entry in the manifest, since it says where its numbers come from.
    """
    cells = json.loads(source.read_text(encoding="utf-8"))["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    try:
        facts = section(folder, source.stem)
    except InputError:
        facts = None
    texts = ["".join(cell["source"]) for cell in cells]
    digest = hashlib.sha256(json.dumps([texts, parameters, facts, code_digest(code)]).encode())
    files = {path for kind in ("csv", "json", "npz", "png") for path in folder.glob(f"{source.stem}*.{kind}")}
    files |= {place / name for place in (REFERENCE, folder) for name in re.findall(r"[\w]+\.csv", code)}
    for path in sorted(file for file in files if file.is_file()):
        digest.update(path.name.encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def main(arguments: list[str] | None = None) -> int:
    """Run one notebook from the command line; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m replicate.report.notebooks", description="Execute a notebook.")
    parser.add_argument("notebook", help="its name, for instance table2")
    parser.add_argument("results", help="reference, or the profile of a run of yours")
    options = parser.parse_args(arguments)
    return guard(lambda: print(run_notebook(options.notebook, options.results)))


if __name__ == "__main__":
    sys.exit(main())


# Where the results on a page come from, in words: commits, commands, seeds, machine, versions and times.

COMMIT_LENGTH = 12  # hexadecimal digits of a commit on pages; manifests have all
LINE = 104  # characters in a line of a page 1,000 px wide
FEW_STAGES = 4  # pages name at most so many stages
FEW_NAMES = 3  # and a line so many runs


def show_provenance(name: str, target: str = "table2") -> None:
    """Show where the results of a target come from: one line, and all of `provenance_text` once a reader clicks it."""
    show_origin(provenance_line(name, target), provenance_text(name, target), folder_of(name))


def show_origin(line: str, text: str, folder: Path) -> None:
    """Show a line with a link to a folder's manifest, and a text in lines of its own once a reader clicks it."""
    from IPython.display import display

    committed = folder in committed_folders().values()  # a committed notebook shows it; other notebooks lie beside it
    place = Path(os.path.relpath(folder, NOTEBOOKS)).as_posix() + "/" if committed else ""
    link = f'<a href="{html.escape(place + MANIFEST)}">manifest</a>'
    summary = f"<summary>{html.escape(line, quote=False)} ({link})</summary>"
    whole = f"<details>{summary}\n<pre>{html.escape(text, quote=False)}</pre>\n</details>"
    display({"text/html": whole, "text/markdown": plain_markdown(line)}, raw=True)


def provenance_line(name: str, target: str = "table2") -> str:
    """Return where the results of a target come from in one line: the runs, their commits, profiles and seeds."""
    manifest = section(folder_of(name), target)
    entries = [{**manifest, **facts} for facts in (manifest.get("characters") or {"": {}}).values()]
    seeds = sorted({seed for facts in entries for seed in facts.get("seeds") or ()})
    commits = [name for facts in entries if (git := facts.get("git")) for name in git.get("commits") or [git["commit"]]]
    parts = (
        _named("run", [facts["run"] for facts in entries if "run" in facts]),
        _named("commit", [commit[:COMMIT_LENGTH] for commit in commits]),
        _named("profile", [facts["profile"] for facts in entries if facts.get("profile")]),
        _named("seed", map(str, seeds)),
    )
    return f"Where these numbers come from: {', '.join(filter(None, parts)) or 'unknown'}."


def _named(word: str, names: Iterable[str]) -> str:
    """Return a word with its names, or how many there are where a line has no room for them: "run 0f41", "7 runs"."""
    several = list(dict.fromkeys(names))
    if len(several) > FEW_NAMES:
        return f"{len(several)} {word}s"
    *most, last = several or [""]
    return f"{word}s {', '.join(most)} and {last}" if most else f"{word} {last}" if last else ""


def provenance_text(name: str, target: str = "table2") -> str:
    """Return where the results of a target come from, by the manifest beside them.

    Facts that all characters share appear once; other lines name their characters.
    """
    folder = folder_of(name)
    manifest, lines = section(folder, target), {"results": display_path(folder)}
    entries = manifest.get("characters") or {"": {}}
    characters = {character: entries[character] for character in sorted(entries, key=order_of)}
    whose: dict[tuple[str, str], list[str]] = {}
    for character, facts in characters.items():
        for fact in _facts_in_words({**manifest, **facts}).items():
            whose.setdefault(fact, []).append(character)
    shared = [fact for fact, of in whose.items() if len(of) == len(characters)]
    others = [fact for fact in whose if fact not in shared]
    lines |= dict(shared) | {f"{label}, {' '.join(whose[label, value])}": value for label, value in others}
    return as_lines({label: _in_lines(value) for label, value in lines.items()})


def _in_lines(value: str) -> str:
    """Wrap a value into lines that fit a page, with an indent for continued ones."""
    room = {"width": LINE - LABELS, "subsequent_indent": "  ", "break_long_words": False, "break_on_hyphens": False}
    return "\n".join(part for line in value.split("\n") for part in textwrap.wrap(line, **room))


def _facts_in_words(facts: dict) -> dict[str, str]:
    stages = (facts.get("stages") or {}).values()
    seconds = [stage.get("wall_s", 0) for stage in stages]
    settings = {
        "profile, seeds": f"{facts.get('profile')}, {facts.get('seeds')}",
        **({"test poses": f"split by {facts['split']}"} if "split" in facts else {}),
    }
    pictures = {"pictures drawn anew": _commits(drawn)} if (drawn := facts.get(DRAWN)) else {}
    if POSES in facts:  # Table 2's entry has the other facts
        return {"numbers from": f"{facts[POSES]} of Table 2's run {facts['run']}", **settings, **pictures}
    gpu = facts.get("gpu") or next((stage["gpu"] for stage in stages if stage.get("gpu")), "none")
    return {
        "commit": _commits(facts.get("git")),
        "command": str(facts.get("command")).replace("; ", "\n"),
        **settings,
        "machine": f"{facts.get('processor')}, {facts.get('cores')} cores, GPU: {gpu}",
        "packages": ", ".join(f"{name} {version}" for name, version in sorted((facts.get("packages") or {}).items())),
        **pictures,
        **({"made elsewhere": elsewhere} if (elsewhere := _elsewhere(facts)) else {}),
        "time of all stages": f"{sum(seconds) / 60:.1f} min",
    }


def _elsewhere(facts: dict) -> str:
    """Return which stages, or how many, were made with other versions or on other processors than the run's."""
    titles: dict[str, list[str]] = {}
    for title, stage in (facts.get("stages") or {}).items():
        differing = {name: stage[name] for name in ("python", "processor", "instruction_set") if name in stage}
        differing |= stage.get("packages", {})
        if differing:
            titles.setdefault(", ".join(f"{name} {value}" for name, value in differing.items()), []).append(title)
    return "\n".join(
        f"{how}: {', '.join(names) if len(names) <= FEW_STAGES else f'{len(names)} stages'}"
        for how, names in titles.items()
    )


def _commits(git: dict | None) -> str:
    """Return the commits that stages were made from, the table's first, and whether their trees had changes."""
    if not git:
        return "unknown"
    names = [name[:COMMIT_LENGTH] for name in dict.fromkeys([git["commit"], *git.get("commits", ())])]
    whose = "its" if len(names) == 1 else "their"
    return " and ".join(names) + ("" if git["clean"] else f", with changes of {whose} own")
