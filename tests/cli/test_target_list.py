"""The registry of targets: each says what it is, takes known options, and is what `make` and `--help` list."""

import re
import shlex
import shutil
import subprocess

import pytest

from replicate import __main__ as cli
from replicate.base.paths import ROOT
from replicate.benchmarks.common import make_parser, parse
from replicate.cli.options import OPTIONS
from replicate.cli.parser import parser
from replicate.cli.target_list import targets
from replicate.methods.method_registry import choose
from replicate.report.results import STANDS_FOR, cast

ALL = list(targets().values())
OF_MAKE = ("help", "environment", "lab", "book", "course", "test", "test-fast", "lint", "mutants", "clean-all")
DRAW_ALL = ("table1", "figure05", "figure07", "figure08", "rig-report", "rigs")


def run_make(*words: str) -> subprocess.CompletedProcess:
    """Run make as from a terminal, though these tests may be make's own."""
    clean = ["env", *(f"-u{option.upper()}" for option in OPTIONS), "-uMAKEFLAGS", "-uCLUSTER", "-uONLY", "-uMAKELEVEL"]
    return subprocess.run([*clean, "make", *words], cwd=ROOT, capture_output=True, text=True)


def make(*words: str) -> str:
    """Return what make prints; no variable of this process's environment is seen."""
    if shutil.which("make") is None:
        pytest.skip("needs make")
    process = run_make(*words)
    assert process.returncode == 0, process.stderr
    return process.stdout


def handed_on(*words: str) -> list[str]:
    """Return the words after the program's name that `make -n` would call, but for make's own number."""
    output = make("-n", *words).replace("\\\n", " ")
    (line,) = (line for line in output.splitlines() if " -m replicate" in line)
    words = shlex.split(line.partition(" -m ")[2])
    if "--from-make" in words:
        assert words.pop(words.index("--from-make") + 1).isdecimal()
    return words


@pytest.mark.parametrize("target", ALL, ids=lambda target: target.name)
def test_a_target_says_what_it_makes_and_where_and_takes_known_options(capsys, target):
    assert target.about and target.writes and '"' not in target.about and len(target.about) < 110
    assert len(set(target.options)) == len(target.options) and set(target.options) <= set(OPTIONS)
    assert cli.main([target.name, "--help"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("usage:") and "REPLICATE_CACHE" in text
    assert " ".join(target.about.split())[1:] in " ".join(text.split())
    assert set(re.findall(r"^  --([a-z-]+)", text, re.MULTILINE)) == {*target.options}


def test_tables_come_first_and_compare_knows_them():
    assert [target.name for target in ALL if target.in_comparison] == ["table1", "table2", "table3", "table4"]
    assert list(targets())[:4] == ["table1", "table2", "table3", "table4"]


def test_what_trains_nothing_takes_all_of_the_papers_characters_that_have_a_recipe():
    there = tuple(name for name in STANDS_FOR if (ROOT / f"data_recipes/{name}.toml").is_file())
    assert cast() == there and "teen" in there
    for target in ALL:
        assert target.characters() == (there if target.name in DRAW_ALL else ("teen",)), target.name


def test_a_target_may_have_methods_of_its_own_that_are_shown_if_none_is_named(capsys):
    defaults = {t.name: parser().parse_args([t.name]).methods for t in ALL if "methods" in t.options}
    assert defaults.pop("figure12") == ["refined"]
    assert defaults.pop("deploy") == ["coarse", "refined", "dense", "regional", "linear"]
    assert defaults.pop("poser") == ["regional"]
    assert all(methods == ["standard"] for methods in defaults.values()) and "table2" in defaults
    assert cli.main(["figure12", "--help"]) == 0 and "(default: refined)" in capsys.readouterr().out


@pytest.mark.parametrize("target", [t for t in ALL if t.stages], ids=lambda target: target.name)
def test_a_targets_graph_ends_with_the_stage_of_its_name_and_trains_no_more_than_it_needs(target):
    from replicate.config import resolve
    from replicate.engine.stage import in_order
    from replicate.methods.plan import Plan

    graph = in_order(target.stages(Plan(resolve("tiny", "quick")), choose(["coarse", "lbs16"])))
    assert graph[-1].title == f"{target.name.replace('-', '_')}-tiny"
    trained = {stage.name for stage in graph} & {"coarse", "refined", "dense", "linear", "pca", "driven"}
    own = {"table2": {"coarse"}, "figure10": {"coarse"}, "figure01": {"coarse", "refined"}}
    own |= {
        "figure09": own["figure01"] | {"dense", "linear"},
        "figure13": own["figure01"],
        "table3": {"coarse"},
        "table4": {"coarse"},
    }
    own["deploy"] = own["poser"] = {"coarse"}
    own |= {"figure11": {"coarse", "refined", "dense"}, "figure12": own["figure01"]}
    assert trained == own.get(target.name, set())


def test_make_help_lists_the_registrys_targets_and_the_benchmarks():
    text = make("help")
    descriptions = dict(re.findall(r"^  ([a-z0-9-]+) +(\S.*)", text, re.MULTILINE))
    benchmarks = {
        file.stem.replace("_", "-"): re.search(r'^ABOUT = "(.*)"$', file.read_text("utf-8"), re.MULTILINE)[1]
        for file in (ROOT / "replicate" / "benchmarks").glob("bench_*.py")
    }
    own = {name: descriptions.pop(name) for name in OF_MAKE}
    assert all(own.values()) and len(benchmarks) >= 6
    assert descriptions == {name: target.about for name, target in targets().items()} | benchmarks


def test_make_hands_the_variables_that_are_set_to_a_target():
    arguments = handed_on("table2", "PROFILE=quick", "SEED=0 1", "LATEX=1")
    assert arguments == ["replicate", "table2", "--from-make", "--profile", "quick", "--seed", "0 1", "--latex"]
    assert handed_on("rigs") == ["replicate", "rigs", "--from-make", "--profile", "laptop"]
    assert handed_on("rig-report") == ["replicate", "rig-report", "--from-make", "--profile", "laptop"]
    assert "tests/mutants.py --only 'Eq. 1' --jobs '1'" in make("-n", "mutants", "ONLY=Eq. 1", "JOBS=1")
    assert handed_on("clean-all")[:3] == ["replicate", "clean", "--all"]


@pytest.mark.parametrize("value", ['"my face.toml" teen', "'my face.toml',teen", "it's $$ and `this`"])
def test_make_hands_on_quotes_as_they_stand(value):
    arguments = handed_on("table2", f"CHARACTERS={value}")
    assert arguments[arguments.index("--characters") + 1] == value.replace("$$", "$")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["tabel2"], "there is no target tabel2; did you mean table2?"),
        (["figure1"], "there is no target figure1; did you mean figure01?"),
        (["bench_rig"], "there is no target bench_rig; did you mean bench-rig?"),
        (["quaternion"], "there is no target quaternion; `make` alone lists them"),
        (["table2", "CHARACTER=woman"], "there is no variable CHARACTER; did you mean CHARACTERS?"),
    ],
)
def test_make_says_which_name_a_mistyped_word_may_have_meant(words, sentence):
    process = run_make(*words)
    assert process.returncode == 2 and sentence in process.stderr and not process.stdout


def test_make_hands_a_benchmark_its_characters():
    arguments = handed_on("bench-ladder", "CHARACTERS=teen tiny", "ONLY=regional|linear")
    assert arguments[:2] == ["replicate.benchmarks.bench_ladder", "--from-make"] and "teen tiny" in arguments
    assert arguments[-2:] == ["--only", "regional|linear"]


def test_a_benchmark_says_which_variables_count_for_nothing(capsys):
    options, _ = parse(make_parser("bench_toy", "a toy"), ["--from-make", "--profile", "quick", "--methods", "dense"])
    assert options.characters == "teen" and not hasattr(options, "methods")
    assert capsys.readouterr().err == "left out, since this command has no such option: METHODS\n"
