"""Break one core line at a time in a copy of the project, and see that a test notices.

mutants.toml lists them: a file, a piece of its text, what takes its place, the tests that should turn red, and why.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
LIMIT_S, GREEN, RED = 1_800, 0, 1  # for one run of pytest, and what it ends with; anything else is no verdict


class Mutant(NamedTuple):
    """A change of one file, and the test files that should notice."""

    file: str
    line: str
    becomes: str
    tests: list[str]
    why: str


def read_list(root: Path) -> list[Mutant]:
    """Return the mutants of a project, in the order of its list."""
    return [Mutant(**entry) for entry in tomllib.loads((root / "tests/mutants.toml").read_text("utf-8"))["mutant"]]


def mutated(mutant: Mutant, text: str) -> str | None:
    """Return a file's text with the mutation, or None unless the mutant's line is there exactly once."""
    return text.replace(mutant.line, mutant.becomes) if text.count(mutant.line) == 1 else None


def copy_project(root: Path, folder: Path) -> None:
    """Copy what git tracks, as it stands in the working tree."""
    command = ["git", "-C", str(root), "ls-files", "-z"]
    for name in subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0"):
        if name and (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(root / name, folder / name)
    (folder / ".scratch").mkdir()


def run_tests(tests: list[str], copy: Path) -> tuple[int, str, str]:
    """Run test files in a copy of the project; return what pytest ends with, the verdict in words, and its output."""
    scratch = str(copy / ".scratch")
    # No bytecode is kept: it is told apart by size and second, and a mutant must not meet what another left.
    environment = os.environ | {"REPLICATE_CACHE": scratch, "TMPDIR": scratch, "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    start = time.monotonic()
    with tempfile.TemporaryFile("w+", encoding="utf-8") as file:
        streams = {"stdout": file, "stderr": subprocess.STDOUT, "stdin": subprocess.DEVNULL}
        try:
            code = subprocess.run(command, cwd=copy, env=environment, timeout=LIMIT_S, **streams).returncode
        except subprocess.TimeoutExpired:
            code = -1
        file.seek(0)
        verdict = {GREEN: "SURVIVED", RED: "killed"}.get(code, "NO VERDICT")
        return code, f"{verdict} in {time.monotonic() - start:.0f} s", file.read()


def judge(mutant: Mutant, copies: SimpleQueue) -> tuple[Mutant, str]:
    """Return a mutant and the verdict of its tests, in one of some copies of the project, which is left as it was."""
    copy = copies.get()
    file = copy / mutant.file
    before = file.read_bytes() if file.is_file() else b""
    try:
        if (text := mutated(mutant, before.decode("utf-8"))) is None:
            return mutant, "STALE: its line is not there"
        file.write_text(text, encoding="utf-8")
        return mutant, run_tests(mutant.tests, copy)[1]
    finally:
        if before:
            file.write_bytes(before)
        copies.put(copy)


def main(arguments: list[str] | None = None, root: Path = ROOT) -> int:
    """Judge all mutants, or some; return 0 if every one is killed by tests that are green without it, else 1."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", default="", metavar="WORDS", help="mutants whose file or reason holds these words")
    parser.add_argument("--jobs", type=int, default=2, help="how many side by side (default: 2)")
    options = parser.parse_args(arguments)
    chosen = [mutant for mutant in read_list(root) if options.only.lower() in f"{mutant.file} {mutant.why}".lower()]
    if not chosen or options.jobs < 1:
        parser.error(f"expected words of a mutant and at least 1 job, got {options.only!r} and {options.jobs}")
    killed, copies = 0, SimpleQueue()  # copies that no job is at work in
    with tempfile.TemporaryDirectory(prefix="replicate-mutants-") as folder, ThreadPoolExecutor(options.jobs) as pool:
        for copy in [Path(folder, str(job)) for job in range(options.jobs)]:
            copy_project(root, copy)
            copies.put(copy)
        tests = sorted({test for mutant in chosen for test in mutant.tests})
        print(f"{len(tests)} test files without any mutant ...", flush=True)
        code, _, output = run_tests(tests, copy)
        if code != GREEN:
            print(f"{output}\nexpected green tests, since red ones prove nothing, got these", flush=True)
            return 1
        try:
            for number, future in enumerate(as_completed([pool.submit(judge, each, copies) for each in chosen]), 1):
                mutant, verdict = future.result()
                killed += verdict.startswith("killed")
                print(f"[{number}/{len(chosen)}] {verdict}: {mutant.file}: {mutant.why}", flush=True)
        finally:
            pool.shutdown(cancel_futures=True)  # at Ctrl-C
    print(f"{killed} of {len(chosen)} mutants killed")
    return int(killed < len(chosen))


if __name__ == "__main__":
    sys.exit(main())
