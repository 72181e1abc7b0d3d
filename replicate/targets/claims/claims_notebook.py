"""What the notebook about the claims opens: verdicts of a folder of results, the numbers behind them, their origin."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from replicate.engine.exceptions import InputError
from replicate.engine.provenance import as_lines
from replicate.report.notebooks import folder_of
from replicate.report.provenance_text import provenance_text
from replicate.targets.claims.claim_verdicts import FILE, Verdict, read_verdicts, verdict_frame
from replicate.targets.claims.evidence import Evidence, folders_of, gather, published
from replicate.targets.table3.gpu_machine import GPU_TABLE

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class OpenClaims:
    """The verdicts of some results, as objects and as a DataFrame, and the evidence: our numbers and the paper's."""

    verdicts: list[Verdict]
    frame: "pandas.DataFrame"
    ours: Evidence
    paper: Evidence


def open_claims(name: str) -> OpenClaims:
    """Open the verdicts of some results. name: "reference", or the profile of a run.

    Raises InputError, with the target that writes them, where there are none.
    """
    file = folder_of(name) / FILE
    return OpenClaims(read_verdicts(file), verdict_frame(file), gather(folders_of(name)), published())


def claims_provenance_text(name: str) -> str:
    """Return where the numbers behind some verdicts come from: the folder of each table, and each folder's manifest."""
    places = gather(folders_of(name)).places
    tables: dict[tuple[str, str], list[str]] = {}
    for (table, character), place in places.items():
        tables.setdefault((table, place), []).append(character)
    if not tables:
        return "no numbers to judge by are there yet"
    texts = [as_lines({f"{table}, {place}": ", ".join(names) for (table, place), names in tables.items()})]
    for table, place in tables:
        try:
            target = "table3" if table == GPU_TABLE else table
            texts.append(f"{table}, {place}\n{provenance_text(place, target)}")
        except InputError:  # rows without a manifest: their column `run` names the run
            continue
    return "\n\n".join(texts)
