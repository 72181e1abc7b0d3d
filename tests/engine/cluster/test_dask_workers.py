"""A run on a Dask cluster ends as the same run on one machine does, whatever is killed, and leaves no process."""

import contextlib
import ipaddress
import json
import os
import signal
import socket
import sys
import threading
import time

import distributed
import psutil
import pytest
from toy_runs import contents, dask_workers_at_work, gone, launch, processes_of, start, survivors, wait_for
from toy_stages import toy_graph

from replicate.base.exceptions import RunError
from replicate.engine.cluster import clusters
from replicate.engine.cluster.clusters import connect, local_workers
from replicate.engine.cluster.config import LocalCluster

STAGE = "replicate.engine.worker"
GRAPH = (0.22, 10)  # seconds of a step, and steps: more than the two seconds after which a stage speaks


@pytest.fixture(autouse=True)
def nothing_survives(tmp_path):
    """No process that a test has started outlives it."""
    yield
    assert survivors(tmp_path) == []


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """What a local run of the slow graph writes."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert start(folder, *GRAPH, 2).wait(120) == 0
    return contents(folder, toy_graph(*GRAPH))


def finish(process, seconds=120):
    """Wait for a run and return what it said; it must succeed."""
    out, said = process.communicate(timeout=seconds)
    assert process.returncode == 0, said
    return out, said


def test_a_cluster_on_this_machine_writes_what_a_local_run_writes(cache, undisturbed):
    out, said = finish(start(cache, *GRAPH, 1, "local:2"))
    assert contents(cache, toy_graph(*GRAPH)) == undisturbed
    assert "made 5 of 5 artefacts" in out
    lines = [line.partition(" in ")[0] for line in said.splitlines()]
    stages = ("first", "middle-0", "middle-1", "middle-2")
    said_of_them = [line for line in lines if not line.startswith("last")]  # on a busy machine it is named
    assert {f"{stage}: made" for stage in stages} | {"first: started"} <= set(said_of_them)
    assert set(said_of_them) <= {f"{stage}: {word}" for stage in stages for word in ("started", "made")}


def test_a_cluster_on_this_machine_is_reached_from_this_machine_alone(cache):
    process = start(cache, 1.0, 20, 1, "local:2")
    wait_for(lambda: processes_of(cache, STAGE), "stage")
    run = psutil.Process(process.pid)
    listening = {one.pid: listening_at(one) for one in [run, *run.children(recursive=True)]}
    process.terminate()
    process.communicate(timeout=15)
    assert sum(map(bool, listening.values())) >= 3, "the scheduler and two workers"
    addresses = [ipaddress.ip_address(address) for found in listening.values() for address in found]
    assert all(address.is_loopback for address in addresses), listening


def listening_at(process):
    """Return the addresses at which a process takes connections, or datagrams."""
    with contextlib.suppress(psutil.NoSuchProcess):
        sockets = process.net_connections("inet")
        return [one.laddr.ip for one in sockets if one.type == socket.SOCK_DGRAM or one.status == psutil.CONN_LISTEN]
    return []


def _worker_with_stages(cache) -> tuple[psutil.Process, list[psutil.Process]] | None:
    """Return a Dask worker and the stages that it runs; one that has just been killed is none."""
    for worker in dask_workers_at_work(cache):
        with contextlib.suppress(psutil.NoSuchProcess):
            if stages := worker.children():
                return worker, stages
    return None


def test_a_dask_worker_that_is_killed_twice_changes_nothing_and_its_stage_ends_with_it(cache, undisturbed):
    process = start(cache, *GRAPH, 1, "local:2")
    for _ in range(2):
        victim, stages = wait_for(lambda: _worker_with_stages(cache), "Dask worker at work")
        victim.kill()
        wait_for(lambda stages=stages: gone(stages), "end of the stage", 5)
        time.sleep(0.5)
    finish(process)
    assert contents(cache, toy_graph(*GRAPH)) == undisturbed


def test_a_client_that_is_killed_leaves_nothing_behind_and_can_be_started_again(cache, undisturbed):
    process = start(cache, *GRAPH, 1, "local:2")
    wait_for(lambda: processes_of(cache, STAGE), "stage")
    process.kill()
    process.communicate()
    assert survivors(cache) == []
    finish(start(cache, *GRAPH, 1, "local:2"))
    assert contents(cache, toy_graph(*GRAPH)) == undisturbed


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_ends_a_cluster_and_its_stages(cache, number):
    toys = [sys.executable, "-c", "import os; os.setsid(); import toy_stages; toy_stages.main()", "1.0", "20", "1"]
    process = launch([*toys, "local:2"], cache)
    wait_for(lambda: processes_of(cache, STAGE), "stage")
    (os.kill if number == signal.SIGTERM else os.killpg)(process.pid, number)  # terminals send theirs to the group
    said = process.communicate(timeout=15)[1]
    assert process.returncode == (-number if number == signal.SIGINT else 128 + number)
    assert ("KeyboardInterrupt" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}: ") in said
    assert survivors(cache, 5) == []


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("input", "InputError: head.toml: teeth: expected an even number, got 3"),
        ("error", "RunError: stage faulty failed (RuntimeError: the fault that was asked for); its log is "),
        ("kill", "RunError: stage faulty was killed by SIGKILL, probably because memory ran out, on "),
    ],
)
def test_a_stage_that_fails_ends_the_run_with_the_sentence_of_a_local_run(cache, tmp_path, fault, sentence):
    program = (
        "import sys, toy_stages, replicate.engine.scheduler as scheduler; "
        "scheduler.run(toy_stages.faulty_graph(sys.argv[1]), cluster='local:2')"
    )
    process = launch([sys.executable, "-c", program, fault], cache, TOY_FAULTS=str(tmp_path / "faults"))
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 1 and sentence in said.splitlines()[-1], said
    tries = (tmp_path / "faults").read_text().splitlines()
    assert len(tries) == (3 if fault == "kill" else 1), "a stage that was killed, and no other, is tried again"


@contextlib.contextmanager
def scheduler_and_workers(cache, *options, workers=2, **variables):
    """Run what REPRODUCING tells to start by hand; yield the scheduler's process and address."""
    file = cache.parent / "scheduler.json"
    with contextlib.ExitStack() as stack:

        def begin(module, *arguments):
            process = launch(
                [sys.executable, "-m", f"distributed.cli.{module}", *map(str, arguments)], cache, **variables
            )
            stack.callback(process.communicate)
            stack.callback(process.terminate)
            return process

        local = ("--host", "127.0.0.1", "--no-dashboard")
        scheduler = begin("dask_scheduler", *local, "--port", 0, "--scheduler-file", file)
        address = json.loads(wait_for(lambda: file.exists() and file.read_text(), "scheduler"))["address"]
        for _ in range(workers):
            begin("dask_worker", address, *local, "--nthreads", 1, *options)
        if workers:
            with distributed.Client(address, set_as_default=False) as client:
                client.wait_for_workers(workers, timeout=30)
        yield scheduler, address


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """The address of a scheduler with one worker, whose stages are noted in a file."""
    folder = tmp_path_factory.mktemp("running")
    with scheduler_and_workers(folder / "cache", "--resources", "CPU=1", TOY_BUILDS=str(folder / "builds")) as (_, at):
        yield at, folder / "builds"
    assert survivors(folder) == []


def test_two_runs_on_one_scheduler_share_what_they_share(cache, running, undisturbed):
    address, builds = running
    builds.unlink(missing_ok=True)
    both = [start(cache, *GRAPH, 1, address)]
    wait_for(lambda: processes_of(cache, STAGE), "stage")  # which the second run must not disturb
    both.append(start(cache, *GRAPH, 1, address))
    said = [finish(process) for process in both]
    assert contents(cache, toy_graph(*GRAPH)) == undisturbed
    assert all("made 5 of 5 artefacts" in out for out, _ in said)
    made = builds.read_text().splitlines()
    assert sorted(made) == sorted(set(made)) and len(made) == 4


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_run_that_is_ended_frees_the_workers_of_a_running_cluster_for_the_next(cache, number, running, undisturbed):
    process = start(cache, 1.0, 100, 1, running[0])
    stages = wait_for(lambda: processes_of(cache, STAGE), "stage")
    process.send_signal(number)
    process.communicate(timeout=15)
    wait_for(lambda: gone(stages), "end of the stages", 10)
    finish(start(cache, *GRAPH, 1, running[0]))
    assert contents(cache, toy_graph(*GRAPH)) == undisturbed


def most_clients_of_a_task():
    """Return a function that counts, in the scheduler, how many clients want the same task."""
    return lambda dask_scheduler: max((len(task.who_wants) for task in dask_scheduler.tasks.values()), default=0)


def test_a_run_that_ends_leaves_a_stage_to_the_run_that_shares_it(cache, running, undisturbed):
    first, second = (start(cache, 0.3, 20, 1, running[0]) for _ in range(2))
    with distributed.Client(running[0], set_as_default=False) as client:
        wait_for(lambda: client.run_on_scheduler(most_clients_of_a_task()) == 2, "stage that both runs want")
    stage = wait_for(lambda: processes_of(cache, STAGE), "stage")
    first.terminate()
    first.communicate(timeout=15)
    assert not gone(stage)
    out, said = finish(second)
    assert "made 5 of 5 artefacts" in out, said


def test_a_scheduler_that_is_killed_ends_the_run_with_a_sentence(cache):
    with scheduler_and_workers(cache, "--resources", "CPU=1", workers=1) as (scheduler, address):
        process = start(cache, 1.0, 100, 1, address)
        wait_for(lambda: processes_of(cache, STAGE), "stage")
        scheduler.kill()
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 1 and said.splitlines()[-1].startswith("replicate.base.exceptions.RunError: "), said
    assert f"the Dask scheduler at {address} is gone" in said.splitlines()[-1]


@pytest.mark.parametrize(("workers", "reason"), [(0, "it has no workers"), (1, "none of its 1 workers offers CPUs")])
def test_a_scheduler_without_workers_that_offer_cpus_is_a_sentence(cache, workers, reason):
    with scheduler_and_workers(cache, workers=workers) as (_, address):
        said = start(cache, 0, 1, 1, address).communicate(timeout=60)[1].splitlines()[-1]
    assert f"RunError: CLUSTER is {address}: {reason}: start some in " in said
    assert f"`python -m distributed.cli.dask_worker {address} --nthreads 1 --resources CPU=1`" in said


def test_where_no_scheduler_listens_a_sentence_comes_within_seconds(cache):
    began = time.monotonic()
    process = start(cache, 0, 1, 1, "tcp://127.0.0.1:9")
    said = process.communicate(timeout=60)[1].splitlines()[-1]
    assert "InputError: CLUSTER is tcp://127.0.0.1:9: found no Dask scheduler there" in said
    assert time.monotonic() - began < 20


def test_each_gpu_has_a_dask_worker_of_its_own():
    described = local_workers(3, ["0", "GPU-5c"], "/folder").values()
    seen = [(one["options"]["env"]["CUDA_VISIBLE_DEVICES"], one["options"]["resources"]) for one in described]
    assert seen == [("0", {"CPU": 1, "GPU": 1}), ("GPU-5c", {"CPU": 1, "GPU": 1}), ("", {"CPU": 1})]


def test_a_stage_that_wants_a_gpu_is_refused_where_there_is_none(cache):
    program = (
        "import toy_stages as toys, replicate.engine.scheduler as scheduler; "
        "stage = toys.Stage('net', 'toy_stages:environment', toys.ToyDevice('cuda')); "
        "scheduler.run([stage], cluster='local:1')"
    )
    said = launch([sys.executable, "-c", program], cache, CUDA_VISIBLE_DEVICES="").communicate(timeout=60)[1]
    assert "RunError: net needs a GPU, and no worker offers one: use DEVICE=cpu" in said.splitlines()[-1]


def test_workers_that_are_killed_while_they_start_are_started_anew(monkeypatch):
    starts, whole = [], distributed.SpecCluster

    def started(*arguments, **named):
        if not starts:
            threading.Thread(target=kill_a_starting_worker, daemon=True).start()
        starts.append(named)
        return whole(*arguments, **named)

    monkeypatch.setattr(distributed, "SpecCluster", started)
    connection = connect(LocalCluster(2))
    try:
        assert len(starts) == 2 and len(connection.client.scheduler_info()["workers"]) == 2
    finally:
        connection.client.close()
        connection.cluster.close()


def kill_a_starting_worker():
    """Kill the first worker that this process starts."""
    children = psutil.Process().children
    wait_for(lambda: [child for child in children() if "spawn_main" in " ".join(child.cmdline())], "worker")[0].kill()


def test_workers_that_never_start_end_the_run_with_a_sentence(monkeypatch):
    def refuse(*arguments, **named):
        starts.append(named)
        raise RuntimeError("Nanny failed to start.") from OSError("no room")

    starts = []
    monkeypatch.setattr(distributed, "SpecCluster", refuse)
    with pytest.raises(RunError, match=r"CLUSTER is local:3: a Dask worker ends while it starts \(OSError: no room\)"):
        connect(LocalCluster(3))
    assert len(starts) == clusters.STARTS
