"""Whatever goes wrong behind the door ends in one sentence and an exit code."""

import os
import resource
import signal
import subprocess
import sys
import time

import pytest

from replicate.base import command_line
from replicate.base.exceptions import InputError, RunError
from replicate.base.paths import ROOT

NO_MEMORY = "memory ran out: what is finished is kept; close other programs or name fewer JOBS\n"
COMMANDS = """
import errno, gc, os, sys, time
from pathlib import Path
from replicate.base.exceptions import InputError, RunError

def fine():
    print("done: 3 ± 1")

def lines():
    for number in range(100_000):
        print(number)

def late():
    print("one line that stays in the buffer")

def progress():
    from replicate.base.progress import progress
    from replicate.engine.display import StageDisplay
    display = StageDisplay("körper", 0)
    display.waiting()
    display.progress("zähle", 1, 2)
    display.end("made")
    with progress(2, "zähle") as bar:
        bar.update()
    Path(os.environ["RESULT"]).write_text("written")

def names():
    print("\\udcff is a byte of a file's name")

def input_error():
    raise InputError("head.toml: teeth: expected an even\\nnumber, got 3")

def run_error():
    raise RunError("stage coarse failed")

def memory():
    raise MemoryError

def fork():
    raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

def bad_alloc():
    raise RuntimeError("std::bad_alloc")

def library():
    raise ImportError("libtorch.so: failed to map segment from shared object")

def full():
    raise RuntimeError("I/O: No space left on device (os error 28)")

def code():
    return 5

def cycles():
    print(gc.get_threshold()[0])

def text():
    sys.exit("a last word")

def pipe():
    read, write = os.pipe()
    os.close(read)
    os.write(write, b"to a process that is gone")

def slow():
    print("begun", flush=True)
    time.sleep(30)

def large():
    from replicate.base.files import write_bytes
    write_bytes(Path(os.environ["RESULT"]), bytes(200_000))

def arrays():
    import numpy
    from replicate.base.files import replacing
    with replacing(Path(os.environ["RESULT"])) as new:
        with open(new, "wb") as stream:
            numpy.arange(50_000.0).tofile(stream)
"""
SCRIPT = "import sys; from replicate.base.command_line import run; sys.exit(run(sys.argv[1]))"


@pytest.fixture
def start(tmp_path):
    """Return a function that starts one of the commands above in a process of its own."""
    (tmp_path / "commands.py").write_text(COMMANDS, encoding="utf-8")
    (tmp_path / "imports.py").write_text(
        "print('importing', flush=True)\nimport time\ntime.sleep(30)\ndef main(): pass\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    environment |= {"RESULT": str(tmp_path / "result")}

    def start(function: str, shell: str = "{}", limit: int | None = None, **variables: str) -> subprocess.Popen:
        command = shell.format(f'"{sys.executable}" -c "{SCRIPT}" {function}')
        return subprocess.Popen(
            ["bash", "-c", f"set -o pipefail; trap - INT; {command}"],
            env=environment | variables,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=lambda: limit and resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        )

    return start


def outcome(process: subprocess.Popen) -> tuple[int, str, str]:
    """Return exit code, output and errors."""
    out, errors = process.communicate(timeout=60)
    return process.returncode, out.decode(errors="replace"), errors.decode(errors="replace")


@pytest.mark.parametrize(
    ("function", "code", "sentence"),
    [
        ("input_error", 2, "head.toml: teeth: expected an even number, got 3\n"),
        ("run_error", 1, "stage coarse failed\n"),
        *((words, 1, NO_MEMORY) for words in ("memory", "fork", "bad_alloc", "library")),
        ("text", 1, "a last word\n"),
        ("code", 5, ""),
        ("fine", 0, ""),
    ],
)
def test_what_a_command_raises_or_returns_is_a_sentence_and_a_code(start, function, code, sentence):
    assert outcome(start(f"commands:{function}"))[::2] == (code, sentence)


def test_a_command_looks_for_cycles_of_objects_less_often_than_python_does_by_itself(start):
    by_itself = subprocess.check_output([sys.executable, "-c", "import gc; print(gc.get_threshold()[0])"])
    assert int(outcome(start("commands:cycles"))[1]) > int(by_itself)


def test_an_error_that_nobody_has_foreseen_keeps_its_traceback(start):
    code, _, errors = outcome(start("commands:pipe"))
    assert code == 1 and "BrokenPipeError" in errors, "it is not our output that nobody reads"


def test_output_that_nobody_reads_to_its_end_is_no_error(start):
    code, out, errors = outcome(start("commands:lines", "{} | head -1"))
    assert (code, out, errors) == (141, "0\n", "")


@pytest.mark.parametrize("function", ["late", "lines"])
def test_output_that_nobody_reads_at_all_is_no_error(start, function):
    assert outcome(start(f"commands:{function}", "{} | true")) == (141, "", "")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
@pytest.mark.parametrize("function", ["fine", "names", "progress"])
def test_characters_that_the_output_lacks_are_replaced(start, encoding, function):
    code, _, errors = outcome(start(f"commands:{function}", PYTHONIOENCODING=encoding))
    assert code == 0 and "Traceback" not in errors


@pytest.mark.parametrize("redirection", ["2>&-", ">&-", "<&-", ">&- 2>&- <&-"])
def test_a_command_works_with_its_streams_closed(start, tmp_path, redirection):
    assert outcome(start("commands:progress", "{} " + redirection))[0] == 0
    assert (tmp_path / "result").read_text() == "written"


def test_a_full_output_is_a_sentence(start):
    code, _, errors = outcome(start("commands:fine", "{} > /dev/full"))
    assert code == 1 and errors.startswith("the disk is full") and errors.count("\n") == 1


def test_a_full_disk_is_a_sentence_in_the_words_of_a_library_too(start):
    code, _, errors = outcome(start("commands:full"))
    assert code == 1 and errors.startswith("the disk is full") and errors.count("\n") == 1


@pytest.mark.parametrize("function", ["large", "arrays"])
def test_a_limit_on_files_is_a_sentence_with_the_folder(start, tmp_path, function):
    code, _, errors = outcome(start(f"commands:{function}", limit=100 << 10))
    assert code == 1 and errors.count("\n") == 1 and str(tmp_path) in errors and "100 KB with `ulimit -f`" in errors
    assert not (tmp_path / "result").exists() and not list(tmp_path.glob(".new-*"))


@pytest.mark.parametrize(("function", "word"), [("commands:slow", "begun"), ("imports:main", "importing")])
def test_an_interruption_is_a_sentence_also_while_modules_are_imported(start, function, word):
    process = start(function, "exec {}")
    assert process.stdout.readline().decode().strip() == word
    process.send_signal(signal.SIGINT)
    code, _, errors = outcome(process)
    assert (code, errors) == (130, command_line.INTERRUPTION + "\n")


def test_an_interruption_that_the_shell_ignores_stays_ignored(start):
    process = start("commands:slow", "trap '' INT; exec {}")
    assert process.stdout.readline() == b"begun\n"
    process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    assert process.poll() is None
    process.kill()
    process.communicate()


def test_the_door_loads_next_to_nothing():
    ask = "import sys, replicate.base.command_line; print(len(sys.modules), 'numpy' in sys.modules)"
    process = subprocess.run([sys.executable, "-c", ask], cwd=ROOT, capture_output=True, text=True, check=True)
    count, heavy = process.stdout.split()
    assert int(count) < 120 and heavy == "False"


def test_a_command_may_be_guarded_within_a_process(capsys):
    def refuse() -> None:
        raise InputError("no")

    def fail() -> None:
        raise RunError("not now")

    assert [command_line.guard(body) for body in (refuse, fail, lambda: None, lambda: 3)] == [2, 1, 0, 3]
    assert capsys.readouterr().err == "no\nnot now\n"
