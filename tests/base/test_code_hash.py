"""What a stage depends on is read from imports: every line that can change its numbers, and no other."""

import subprocess
import sys

import pytest

from replicate.base import code_hash as sources
from replicate.base.paths import ROOT

PROGRAM = {
    "toys/__init__.py": '"""A package."""\n',
    "toys/stage.py": """
from toys.direct import helper
SCALE = 2
UNUSED = 3
def body(context):
    from . import inside
    return step(context) * SCALE
def step(context):
    return helper(context)
def other(context):
    from toys import unrelated
""",
    "toys/direct.py": (
        "from toys import aside\nfrom toys.deep.bottom import base\nLABEL = 'a'\n"
        "def helper(x):\n    return base(x) + 1 + aside.used(x)\n"
    ),
    "toys/aside.py": "def used(x):\n    return x * 3\ndef unused(x):\n    return x * 5\n",
    "toys/deep/__init__.py": "",
    "toys/deep/bottom.py": '"""Docs."""\ndef base(x):\n    "Docs."\n    return x  # a comment\n',
    "toys/inside.py": "VALUE = 1\n",
    "toys/unrelated.py": "VALUE = 1\n",
}
CACHED = (
    *(sources._module_file, sources._outline, sources._closure, sources._digest),
    *(sources._reached, sources._written),
)


@pytest.fixture
def digest(tmp_path, monkeypatch):
    """Write the program with some files replaced, and return the digest of its body."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(changes):
        for name, text in {**PROGRAM, **changes}.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        for function in CACHED:
            function.cache_clear()
        return sources.sources_digest("toys.stage:body")

    yield write
    for function in CACHED:
        function.cache_clear()


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("toys/stage.py", "* SCALE", "/ SCALE"),
        ("toys/stage.py", "SCALE = 2", "SCALE = 4"),
        ("toys/stage.py", "return helper(context)", "return -helper(context)"),
        ("toys/direct.py", "+ 1", "+ 2"),
        ("toys/deep/bottom.py", "return x", "return -x"),
        ("toys/deep/__init__.py", "", "import sys\nsys.setrecursionlimit(5_000)\n"),
        ("toys/aside.py", "* 3", "* 4"),
        ("toys/inside.py", "1", "2"),
    ],
)
def test_a_change_of_what_the_function_reaches_is_seen(digest, name, old, new):
    assert digest({name: PROGRAM[name].replace(old, new)}) != digest({})


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("toys/deep/bottom.py", "# a comment", "# another comment"),
        ("toys/deep/bottom.py", "Docs.", "Other docs."),
        ("toys/deep/bottom.py", "return x", "return (x)\n\n"),
        ("toys/stage.py", "UNUSED = 3", "UNUSED = 4"),
        ("toys/stage.py", "def other(context):", "def other(anything):"),
        ("toys/unrelated.py", "1", "2"),
        ("toys/direct.py", "LABEL = 'a'", "LABEL = 'b'"),
        ("toys/aside.py", "* 5", "* 6"),
    ],
)
def test_a_change_that_cannot_matter_is_not_seen(digest, name, old, new):
    assert digest({name: PROGRAM[name].replace(old, new)}) == digest({})


def test_unchanged_texts_are_those_of_every_module_that_the_digest_reads_byte_for_byte(digest):
    digest({})
    texts = sources.source_texts("toys.stage:body")
    read = [name for name in PROGRAM if "unrelated" not in name]
    assert len(texts) == len(read) and sources.are_unchanged(texts)
    for name in PROGRAM:
        digest({name: PROGRAM[name] + "# more"})
        assert sources.are_unchanged(texts) == (name not in read)
    sources._module_file("toys.direct").unlink()
    sources._module_file.cache_clear()
    assert not sources.are_unchanged(texts)


def test_texts_are_those_that_were_read_for_the_digest_whatever_a_file_says_by_now(digest):
    digest({})
    sources._module_file("toys.inside").write_text("VALUE = 2")
    assert not sources.are_unchanged(sources.source_texts("toys.stage:body"))


def test_the_machinery_around_a_stage_does_not_count(digest, monkeypatch):
    inside = {"toys/inside.py": "from replicate.engine.store import make\nVALUE = 1\n"}
    without = digest(inside)
    monkeypatch.setattr(sources, "is_machinery", lambda module: False)
    assert digest(inside) != without


def test_all_machinery_exists():
    assert all(sources._module_file(module) for module in sources.MACHINERY)


def test_a_function_that_is_not_there_is_named():
    with pytest.raises(ValueError, match="no function nothing"):
        sources.sources_digest("toy_stages:nothing")
    with pytest.raises(ValueError, match="no module"):
        sources.sources_digest("toys.nowhere:body")


def test_packages_of_the_user_and_of_other_environments_are_no_sources_of_the_project(tmp_path, monkeypatch):
    mine, theirs = tmp_path / "mine", tmp_path / "local/lib/python3.11/site-packages"
    monkeypatch.setattr(sys, "path", [*sys.path, str(mine), str(theirs)])
    assert mine in sources.project_roots() and theirs not in sources.project_roots()


def test_looking_at_sources_imports_none_of_them():
    program = (
        "import sys; from replicate.base.code_hash import sources_digest;"
        "sources_digest('replicate.approximation.samples:write_samples');"
        "print([m for m in ('jax', 'torch', 'scipy', 'data_recipes') if m in sys.modules])"
    )
    process = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"


def test_what_is_found_in_a_module_is_kept_until_its_text_changes(digest, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    first = digest({})
    (kept,) = (tmp_path / "toys" / "__pycache__").glob("stage.*.opt-outline.json")
    with monkeypatch.context() as patch:
        patch.setattr(sources, "_read", None)  # it would be an error to parse anything
        file = tmp_path / "toys" / "stage.py"
        sources._outline.cache_clear()
        outline = sources._outline(file, "toys.stage")
        assert digest({}) == first
    assert outline == sources._read(file.read_bytes(), file, "toys.stage")
    assert outline != sources._read(file.read_bytes(), file, "stage"), "the module's name counts"
    changed = {"toys/stage.py": PROGRAM["toys/stage.py"].replace("SCALE = 2", "SCALE = 4")}
    assert digest(changed) != first == digest({})
    kept.write_bytes(kept.read_bytes()[:-1] + b"x")
    assert digest({}) == first and f"{kept}: damaged" in capfd.readouterr().err


def test_nothing_is_kept_where_python_keeps_no_bytecode(digest, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert digest({}) and not list(tmp_path.rglob("*.json"))
