"""The manifest of a folder of results: which run made each table and figure, and how.

Table 2's facts are at the top, by character; those of other targets (`table1`, `figure07`, …) have the same form and
are under "targets", by name.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path

from replicate.base.exceptions import InputError
from replicate.base.files import write_text
from replicate.config import Config
from replicate.engine.provenance import graph_git, stage_facts
from replicate.engine.stage import Stage
from replicate.engine.store import artefact_folder, read_manifest

NAME = "manifest.json"
TOP = "table2"
DRAWN = "pictures"  # the key for the commit of pictures that were drawn after their entry was written
POSES = "from"  # the key for the poses of Table 2 that a figure's numbers come from; `run` is then Table 2's
SURROUNDINGS = ("python", "packages", "processor", "instruction_set")


def facts_of(configs: Sequence[Config], lasts: Sequence[Stage], run: str) -> dict:
    """Return where one character's results come from: the run that made them, and every stage behind it.

    configs, lasts: the configuration and the last stage of each seed. If several runs made the seeds, the facts have
    all of their commands; everything else about the run is the first seed's. run: the name of the run.
    """
    runs = [read_manifest(artefact_folder(last.identifier))["run"] for last in lasts]
    commands = dict.fromkeys(each["command"] for each in runs if "command" in each)
    return {
        **runs[0],
        **({"command": "; ".join(commands)} if commands else {}),
        "git": graph_git(lasts),
        "seeds": [config.seed for config in configs],
        "split": configs[0].samples.split,
        "run": run,
        "stages": stage_facts(lasts),
    }


def with_earlier(facts: dict, earlier: dict, run: str) -> dict:
    """Join one character's facts of a run with those of an earlier run of other seeds and the same configuration.

    Facts about the whole are the later run's; stages of the earlier run get their commit, machine and versions where
    these differ. The pictures stay the earlier run's. run: the name of both runs together.
    """
    git, before = facts["git"], earlier["git"]
    pictures = {DRAWN: earlier[DRAWN]} if DRAWN in earlier else {}
    surroundings = {
        name: earlier[name] for name in SURROUNDINGS if name in earlier and earlier[name] != facts.get(name)
    }
    if before["commit"] != git["commit"]:
        surroundings["git"] = {"commit": before["commit"], "clean": before["clean"]}
    stages = {title: {**surroundings, **stage} for title, stage in earlier["stages"].items()} | facts["stages"]
    return {**joined(facts, earlier), **pictures, "run": run, "stages": stages}


def joined(facts: dict, earlier: dict) -> dict:
    """Return the facts of numbers that two runs made together: the later ones, with all commits, commands and seeds."""
    git, before = facts["git"], earlier["git"]
    commits = [name for each in (git, before) for name in (each["commit"], *each.get("commits", ()))]
    commands = dict.fromkeys(each for both in (earlier, facts) for each in both["command"].split("; "))
    return {
        **facts,
        "git": {**git, "clean": git["clean"] and before["clean"], "commits": [*dict.fromkeys(commits)]},
        "command": "; ".join(commands),
        "seeds": sorted({*earlier["seeds"], *facts["seeds"]}),
    }


def entries(folder: Path, target: str) -> dict[str, dict]:
    """Return each character's facts for one target; none if the manifest is missing or damaged."""
    try:
        characters = section(folder, target)["characters"]
        return {name: facts for name, facts in characters.items() if isinstance(facts, dict)}
    except (InputError, KeyError, AttributeError, TypeError):
        return {}


def targets(folder: Path) -> list[str]:
    """Return the names of the targets in a folder's manifest; none if it is missing or damaged."""
    top, others = _other(folder)
    return [*([TOP] if top.get("characters") else []), *others]


def command_of(target: str) -> str:
    """Return the name that `make` has for a target from that of its files: rig-report writes rig_report.csv."""
    return target.replace("_", "-")


def section(folder: Path, target: str) -> dict:
    """Return a manifest's entry of one target: the facts that all characters share, and those of each.

    Raises InputError, with the command that writes it, for a missing entry, and for names of files outside the folder.
    """
    file = folder / NAME
    missing = f"{file}: there is no such manifest; `make {command_of(target)}` writes it with the results."
    try:
        manifest = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(missing) from None
    except ValueError as error:
        raise InputError(f"{file}: expected JSON ({error}).") from None
    if not isinstance(manifest, dict):
        raise InputError(f"{file}: expected a table, got a {type(manifest).__name__}.")
    if target == TOP:
        return {name: value for name, value in manifest.items() if name != "targets"}
    try:
        entry = dict(manifest["targets"][target])
    except (KeyError, TypeError, ValueError):
        how = f"`make {command_of(target)}` writes it with the results"
        raise InputError(f"{file}: it has no entry for {target}; {how}.") from None
    _check_files(file, target, entry)
    return entry


def _check_files(file: Path, target: str, entry: dict) -> None:
    """Raise InputError unless all files that a manifest names are a target's in its folder: they may be deleted."""
    characters = entry.get("characters")
    for character, facts in characters.items() if isinstance(characters, dict) else ():
        files = facts.get("files", []) if isinstance(facts, dict) else []
        for name in files if isinstance(files, list) else [files]:
            if not isinstance(name, str) or not re.fullmatch(rf"{re.escape(target)}_[^/\\\0]+", name):
                expected = f"expected plain names that begin with {target}_, got {name!r}"
                raise InputError(f"{file}, files of {character} in {target}: {expected}.")


def write_entries(folder: Path, target: str, characters: dict[str, dict]) -> None:
    """Write one target's facts into a folder's manifest: first those that all characters share, then each one's.

    Entries of other targets stay; a damaged manifest is replaced.
    """
    each = list(characters.values())
    shared = {
        key: value
        for key, value in each[0].items()
        if key not in ("stages", "run", "files", DRAWN, POSES) and all(facts.get(key) == value for facts in each)
    }
    new = {**shared, "characters": characters}
    top, targets = _other(folder)
    if target == TOP:
        top = new
    else:
        targets = dict(sorted({**targets, target: new}.items()))
    text = json.dumps(top | ({"targets": targets} if targets else {}), indent=1, ensure_ascii=False) + "\n"
    write_text(folder / NAME, text)


def _other(folder: Path) -> tuple[dict, dict]:
    """Return Table 2's facts and the other targets' from a folder's manifest."""
    try:
        manifest = json.loads((folder / NAME).read_text(encoding="utf-8"))
        targets = manifest.pop("targets", {})
        return manifest, targets if isinstance(targets, dict) else {}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}, {}
