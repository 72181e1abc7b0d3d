"""The manifest beside a folder of results: of every table and figure there, which run made it, and how.

Table 2's facts stand at the top, by character; those of other targets (`table1`, `figure07`, …) have the same shape and
stand by their names under "targets".
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
DRAWN = "pictures"  # the word for where pictures come from that are younger than their entry
POSES = "from"  # the word for the poses of Table 2 that a figure's numbers come from; `run` is then Table 2's
SURROUNDINGS = ("python", "packages", "processor", "instruction_set")


def facts_of(configs: Sequence[Config], lasts: Sequence[Stage], run: str) -> dict:
    """Return where one character's results come from: the run that made them, and every stage behind it.

    configs, lasts: the configuration and the last stage of each seed; they differ in nothing else. Where several runs
    made the seeds, their commands stand side by side; what else is said of a run is the first seed's.
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
    """Return one character's facts of a run, and of an earlier one that has other seeds of the same configuration.

    What stands for the whole is the later run's; a stage of the earlier one says itself where it comes from, as far as
    that is something else. The pictures stay the earlier run's. run: the name of both together.
    """
    git, before = facts["git"], earlier["git"]
    pictures = {DRAWN: earlier[DRAWN]} if DRAWN in earlier else {}
    own = {name: earlier[name] for name in SURROUNDINGS if name in earlier and earlier[name] != facts.get(name)}
    if before["commit"] != git["commit"]:
        own["git"] = {"commit": before["commit"], "clean": before["clean"]}
    stages = {title: {**own, **stage} for title, stage in earlier["stages"].items()} | facts["stages"]
    return {**joined(facts, earlier), **pictures, "run": run, "stages": stages}


def joined(facts: dict, earlier: dict) -> dict:
    """Return the facts of numbers that two runs have made together: both commits, commands and seeds."""
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
    """Return each character's own facts for one target; none where the manifest is missing or damaged."""
    try:
        characters = section(folder, target)["characters"]
        return {name: facts for name, facts in characters.items() if isinstance(facts, dict)}
    except (InputError, KeyError, AttributeError, TypeError):
        return {}


def targets(folder: Path) -> list[str]:
    """Return the names of the targets in a folder's manifest; none where it is missing or damaged."""
    top, others = _other(folder)
    return [*([TOP] if top.get("characters") else []), *others]


def command_of(target: str) -> str:
    """Return what `make` calls the target whose files and entries are named so: rig-report writes rig_report.csv."""
    return target.replace("_", "-")


def section(folder: Path, target: str) -> dict:
    """Return what a folder's manifest records of one target: what all characters share, and each one's own facts.

    Raises InputError, with the target that writes it, where there is no such thing, and for names of files that are
    somewhere else than in that folder.
    """
    file = folder / NAME
    missing = f"{file}: there is no such manifest; `make {command_of(target)}` writes it with the results."
    try:
        manifest = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(missing) from None
    except ValueError as error:
        raise InputError(f"{file}: found no JSON ({error}).") from None
    if not isinstance(manifest, dict):
        raise InputError(f"{file}: found a {type(manifest).__name__}, where only a table is allowed.")
    if target == TOP:
        return {name: value for name, value in manifest.items() if name != "targets"}
    try:
        own = dict(manifest["targets"][target])
    except (KeyError, TypeError, ValueError):
        how = f"`make {command_of(target)}` writes it with the results"
        raise InputError(f"{file}: it has no entry for {target}; {how}.") from None
    _check_files(file, target, own)
    return own


def _check_files(file: Path, target: str, own: dict) -> None:
    """Raise InputError unless the files that a manifest names are a target's, in its own folder: they may go later."""
    characters = own.get("characters")
    for character, facts in characters.items() if isinstance(characters, dict) else ():
        files = facts.get("files", []) if isinstance(facts, dict) else []
        for name in files if isinstance(files, list) else [files]:
            if not isinstance(name, str) or not re.fullmatch(rf"{re.escape(target)}_[^/\\\0]+", name):
                entry = f"files of {character} in {target} hold {name!r}"
                raise InputError(f"{file}: {entry}, where only plain names that begin with {target}_ are allowed.")


def write_entries(folder: Path, target: str, characters: dict[str, dict]) -> None:
    """Write one target's facts into a folder's manifest: what all characters share first, then each one's own.

    Entries of other targets stay; a damaged manifest counts as none.
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
    """Return what is there already: Table 2's facts, and the other targets'."""
    try:
        manifest = json.loads((folder / NAME).read_text(encoding="utf-8"))
        targets = manifest.pop("targets", {})
        return manifest, targets if isinstance(targets, dict) else {}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}, {}
