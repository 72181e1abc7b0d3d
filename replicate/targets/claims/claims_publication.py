"""`make claims`: the verdicts on a profile's results, in its folder and printed."""

from pathlib import Path

from replicate.engine.paths import REFERENCE, display_path
from replicate.report.notebooks import run_notebook
from replicate.report.publication import alone, results_folder
from replicate.report.tables import as_latex, as_text
from replicate.targets.claims.claim_verdicts import FILE, NOT_TESTED, Verdict, judge_all, write_verdicts
from replicate.targets.claims.claims_table import claims_table
from replicate.targets.claims.evidence import Evidence, folders_of, gather, published


def publish(profile: str, latex: bool = False) -> None:
    """Judge the claims, write the verdicts to the profile's folder, print them, and execute their notebook if stale.

    latex: print the table as LaTeX, without reasons. Raises InputError for results that are none.
    """
    evidence = gather(folders_of(profile))
    folder = results_folder(profile)
    with alone(folder):
        verdicts = write_claims(folder, evidence)
        run_notebook("claims", profile)
    table = claims_table(verdicts, evidence)
    if latex:
        print(as_latex(table))
        return
    print(as_text(table))
    for one in verdicts:
        if one.verdict != NOT_TESTED:
            print(f"{one.claim} {one.character}: {one.verdict}. {one.reason}")
    print(f"\n{origin(verdicts)}")
    print(f"written to {display_path(folder)}: {FILE}, and claims.ipynb to read it in")


def write_claims(folder: Path, evidence: Evidence) -> list[Verdict]:
    """Write the verdicts that some evidence gives to a folder, and return them."""
    verdicts = judge_all(evidence, published())
    write_verdicts(folder / FILE, verdicts)
    return verdicts


def origin(verdicts: list[Verdict]) -> str:
    """Return which characters' verdicts stand on which folders of results."""
    folders: dict[str, list[str]] = {}
    for one in verdicts:
        if one.results:
            folders.setdefault(one.results, []).append(one.character)
    lines = (f"{name}: {', '.join(dict.fromkeys(characters))}" for name, characters in sorted(folders.items()))
    committed = f" ({REFERENCE.name} is what the project comes with)" if REFERENCE.name in folders else ""
    return f"numbers from {'; '.join(lines)}{committed}" if folders else "no numbers to judge by are there yet"
