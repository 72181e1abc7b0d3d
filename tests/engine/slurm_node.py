"""A real Slurm of one node, this machine, for the time of a test: it needs no systemd and no cgroups."""

import contextlib
import os
import pwd
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

_PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "sinfo")
_PATH = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])


def obstacle() -> str:
    """Return "" if a node can be set up here, else why not."""
    missing = [program for program in _PROGRAMS if shutil.which(program, path=_PATH) is None]
    if missing:
        return f"needs Slurm (Debian: slurm-wlm and munge); there is no {missing[0]}"
    return "" if os.geteuid() == 0 else "needs root: slurmd starts jobs in their owners' names"


@contextlib.contextmanager
def slurm_node(folder: Path, cores: int) -> Iterator[dict[str, str]]:
    """Run a controller and a node in `folder`; yield the environment variables that lead sbatch to them."""
    folder.chmod(0o755)
    socket_file = folder / "munge.socket"
    (folder / "munge.key").write_bytes(os.urandom(128))
    (folder / "munge.key").chmod(0o400)
    host = socket.gethostname().split(".")[0]
    for name in ("state", "spool"):
        (folder / name).mkdir()
    config = folder / "slurm.conf"
    config.write_text(f"""\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={_free_port()}
SlurmdPort={_free_port()}
SlurmUser={pwd.getpwuid(os.geteuid()).pw_name}
AuthType=auth/munge
AuthInfo=socket={socket_file}
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
SlurmdParameters=config_overrides
ReturnToService=2
KillWait=2
OverTimeLimit=0
SchedulerParameters=sched_interval=1,batch_sched_delay=0
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory=8000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
""")
    variables = {"SLURM_CONF": str(config), "PATH": _PATH}
    environment = {**os.environ, **variables}
    munged = ["munged", "--foreground", "--force", f"--key-file={folder}/munge.key", f"--socket={socket_file}"]
    munged += [f"--pid-file={folder}/munged.pid", f"--seed-file={folder}/munge.seed", f"--log-file={folder}/munged.log"]
    with contextlib.ExitStack() as stack:
        for command in (munged, ["slurmctld", "-D"], ["slurmd", "-D", "-N", host]):
            log = stack.enter_context(open(folder / f"{command[0]}.out", "wb"))
            program = shutil.which(command[0], path=_PATH)
            process = subprocess.Popen([program, *command[1:]], env=environment, stdout=log, stderr=log)
            stack.callback(_end, process)
            if command is munged:
                _wait(socket_file.exists, "munged does not start", folder)
        _wait(lambda: "idle" in _ask(["sinfo", "-h", "-o", "%T"], environment), "Slurm does not start", folder)
        stack.callback(_cancel_all, environment)
        yield variables


def jobs(variables: dict[str, str]) -> list[str]:
    """Return the numbers of the jobs that wait or run."""
    return _ask(["squeue", "-h", "-o", "%i"], {**os.environ, **variables}).split()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _ask(command: list[str], environment: dict[str, str]) -> str:
    program = shutil.which(command[0], path=_PATH)
    return subprocess.run([program, *command[1:]], env=environment, capture_output=True, text=True, timeout=30).stdout


def _wait(condition, complaint: str, folder: Path, seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            logs = "\n".join(file.read_text()[-2000:] for file in sorted(folder.glob("*.[lo][ou][gt]")))
            raise AssertionError(f"{complaint}:\n{logs}")
        time.sleep(0.2)


def _cancel_all(environment: dict[str, str]) -> None:
    """Cancel what is left, and wait until the node has ended it."""
    deadline = time.monotonic() + 30
    while (left := _ask(["squeue", "-h", "-o", "%i"], environment).split()) and time.monotonic() < deadline:
        _ask(["scancel", *left], environment)
        time.sleep(0.5)


def _end(process: subprocess.Popen) -> None:
    process.terminate()
    try:
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
