"""Where the results on a page come from, in words: commits, commands, seeds, machine, versions and times."""

import textwrap

from replicate.engine.paths import display_path
from replicate.engine.provenance import LABELS, as_lines
from replicate.report.cast import order_of
from replicate.report.manifest import DRAWN, POSES, section
from replicate.report.notebooks import folder_of

COMMIT_LENGTH = 12  # hexadecimal digits by which pages name a commit; manifests have all
LINE = 104  # characters that a page 1,000 px wide has room for
FEW_STAGES = 4  # pages name no more of them than that


def provenance_text(name: str, target: str = "table2") -> str:
    """Return where the results of a target come from, from the manifest beside them.

    What characters share stands once; where they differ, a line says whose it is.
    """
    folder = folder_of(name)
    manifest, lines = section(folder, target), {"results": display_path(folder)}
    entries = manifest.get("characters") or {"": {}}
    characters = {character: entries[character] for character in sorted(entries, key=order_of)}
    whose: dict[tuple[str, str], list[str]] = {}
    for character, own in characters.items():
        for fact in _facts_in_words({**manifest, **own}).items():
            whose.setdefault(fact, []).append(character)
    shared = [fact for fact, of in whose.items() if len(of) == len(characters)]
    own = sorted(whose.keys() - set(shared), key=list(whose).index)
    lines |= dict(shared) | {f"{label}, {' '.join(whose[label, value])}": value for label, value in own}
    return as_lines({label: _in_lines(value) for label, value in lines.items()})


def _in_lines(value: str) -> str:
    """Return a value in lines that a page does not break, each continued further in."""
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
    if POSES in facts:  # all else is Table 2's
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
    """Return how many stages were made with other versions or on other processors than the run itself, and which.

    Stages are named while they are few; the manifest names them all.
    """
    titles: dict[str, list[str]] = {}
    for title, stage in (facts.get("stages") or {}).items():
        own = {name: stage[name] for name in ("python", "processor", "instruction_set") if name in stage}
        own |= stage.get("packages", {})
        if own:
            titles.setdefault(", ".join(f"{name} {value}" for name, value in own.items()), []).append(title)
    return "\n".join(
        f"{how}: {', '.join(names) if len(names) <= FEW_STAGES else f'{len(names)} stages'}"
        for how, names in titles.items()
    )


def _commits(git: dict | None) -> str:
    """Return the commits that stages were made from, the table's own first, and whether their trees were clean."""
    if not git:
        return "unknown"
    names = [name[:COMMIT_LENGTH] for name in dict.fromkeys([git["commit"], *git.get("commits", ())])]
    whose = "its" if len(names) == 1 else "their"
    return " and ".join(names) + ("" if git["clean"] else f", with changes of {whose} own")
