"""Where numbers come from: the commit, the machine, the versions and the times behind a run."""

import importlib.metadata
import os
import platform
import resource
import subprocess
import sys
from pathlib import Path

from replicate.base.paths import ROOT
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import artefact_folder, read_manifest

_VECTORS = ("avx", "fma", "amx", "asimd", "sve")  # how the names of vector instructions begin
LABELS = 32  # characters of the column with labels
PACKAGES = ("jax", "jaxlib", "numba", "numpy", "scikit-learn", "scipy", "torch")  # those that compute results


def provenance(command: list[str], profile: str, seeds: list[int], workers: int) -> dict:
    """Return what a manifest says about a run: commit, command, profile, seeds, versions, processor, threads, GPU.

    command: the arguments as typed.
    workers: processes side by side; each has one thread unless a stage's manifest says more.

    The GPU is named only if torch is loaded in this process: asking would load it.
    """
    return {
        "git": git_state(),
        "command": " ".join(command),
        "profile": profile,
        "seeds": list(seeds),
        "system": platform.system(),
        **surroundings(),
        "cores": core_count(),
        "workers": workers,
        "gpu": gpu(),
    }


def surroundings() -> dict:
    """Return what the last digits of results depend on beside sources and seeds: versions and processor."""
    return {
        "python": platform.python_version(),
        "packages": package_versions(),
        "processor": processor(),
        "instruction_set": instruction_set(),
    }


def as_lines(facts: dict[str, str]) -> str:
    """Return facts by their labels as lines, all values in one column; a long label gets a separate line."""
    indented = "\n" + " " * LABELS
    return "\n".join(
        f"{label:{LABELS}}" + ("" if len(label) < LABELS - 1 else indented) + value.replace("\n", indented)
        for label, value in facts.items()
    )


def git_state(folder: Path = ROOT) -> dict | None:
    """Return {"commit", "clean"} of the checkout whose root is `folder`, None if it is no such root."""
    if not (folder / ".git").exists():  # without it, git would answer for a repository further up
        return None
    try:
        commit = _git(folder, "rev-parse", "HEAD")
        return {"commit": commit, "clean": not _git(folder, "status", "--porcelain")}
    except (OSError, subprocess.SubprocessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout.strip()


def package_versions() -> dict[str, str]:
    """Return the installed versions of the packages that compute results."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def processor() -> str:
    """Return the processor's name as the system gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    if sys.platform == "darwin":
        answer = subprocess.run(["sysctl", "-n", "machdep.cpu.brand_string"], capture_output=True, text=True)
        if answer.returncode == 0 and answer.stdout.strip():
            return answer.stdout.strip()
    return platform.processor() or platform.machine()


def instruction_set() -> str:
    """Return this processor's vector instructions; sums by AVX2 and by AVX-512 differ in their last digits.

    Libraries choose among them at run time, so one build can give two results on two machines.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    flags = next((line.partition(":")[2].split() for line in lines if line.startswith(("flags", "Features"))), [])
    return " ".join([platform.machine(), *sorted(flag for flag in set(flags) if flag.startswith(_VECTORS))])


def core_count() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def peak_memory_mb() -> float:
    """Return the most memory that this process has held at once since its program was started, in MB.

    On Linux, `getrusage` also counts what the process was before: a copy of its parent. /proc doesn't.
    """
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.is_file() else []
    for line in lines:
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024 * 1024 if sys.platform == "darwin" else 1024)


def gpu() -> str | None:
    """Return the GPU's name if torch is loaded here and sees one."""
    torch = sys.modules.get("torch")
    return torch.cuda.get_device_name(0) if torch is not None and torch.cuda.is_available() else None


def graph_git(stages: list[Stage]) -> dict | None:
    """Return the commit behind a finished graph, {"commit", "clean"}; None if its first stage comes from no checkout.

    "commit" is that of the first stage. "clean" is true only if every stage, inputs included, was made from a clean
    tree. "commits" lists all commits that stages were made from, if there are several.
    """
    states = [_made_from(stage) for stage in in_order(stages)]
    first = _made_from(stages[0])
    if first is None:
        return None
    commits = list(dict.fromkeys(state["commit"] for state in states if state))
    several = {"commits": commits} if len(commits) > 1 else {}
    return {"commit": first["commit"], "clean": all(state and state["clean"] for state in states), **several}


def stage_facts(stages: list[Stage]) -> dict[str, dict]:
    """Return the key, wall time, notes and so on of every stage of a finished graph, by its title.

    "git" is given where it differs from `graph_git`, None for a stage that was made outside a checkout. "python",
    "packages", "processor" and "instruction_set" are given where they differ from those of the run that made the first
    stage; of the packages, only those that differ.
    """
    facts = {}
    top = graph_git(stages)
    run = read_manifest(artefact_folder(stages[0].identifier))["run"]
    shared = top and {name: top[name] for name in ("commit", "clean")}
    for stage in in_order(stages):
        manifest = read_manifest(artefact_folder(stage.identifier))
        keys = ("key", "wall_s", "resumed", "threads", "peak_memory_mb", "gpu", "notes")
        facts[stage.title] = {name: manifest[name] for name in keys if manifest.get(name) not in (None, {}, False)}
        if (git := _made_from(stage)) != shared:
            facts[stage.title]["git"] = git
        facts[stage.title] |= _differences(manifest.get("surroundings", manifest["run"]), run)
    return facts


def _differences(stage: dict, run: dict) -> dict:
    """Return the surroundings of a stage that differ from those of a run; what either of them lacks is left out."""
    names = ("python", "packages", "processor", "instruction_set")
    differences = {name: stage[name] for name in names if name in stage and name in run and stage[name] != run[name]}
    if "packages" in differences:
        versions, others = stage["packages"], run["packages"]
        differing = (name for name in sorted(versions | others) if versions.get(name) != others.get(name))
        differences["packages"] = {name: versions.get(name) for name in differing}
    return differences


def _made_from(stage: Stage) -> dict | None:
    """Return the `git_state` of the run that made a stage's artefact."""
    return read_manifest(artefact_folder(stage.identifier))["run"].get("git")
