"""Containers with little memory, few cores, and a volume that does not fit."""

import os
import pathlib

from engine import inspect, process, run, until
from pinstack import PinstackError
from stacks import FULL_SIZE, LARGE, SMALL, client, ended, send, with_profile

NAME, URL = "limited", "http://127.0.0.1:8082"


class Limited:
    """A container with options of `docker run`."""

    def __init__(self, *options, start=True):
        flags = ["-e", "PINSTACK_AUTH=none", "-p", "127.0.0.1:8082:8080", "--read-only", "--tmpfs", "/tmp"]
        self.told = run("docker", "run", "-d", "--name", NAME, *flags, *options, "pinstack", check=start)
        self.service = client(URL)

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if kind:
            print(run("docker", "logs", "--tail", "30", NAME, check=False))
        run("docker", "rm", "-fv", NAME, check=False)


def log_of_the_end():
    """Waits until the container has ended; what it said."""
    until(lambda: inspect(NAME)["State"]["Status"] == "exited", "the container ends")
    assert inspect(NAME)["State"]["ExitCode"] != 0
    return run("docker", "logs", NAME)


def peak():
    """The most memory that the processes of the container had, bytes: without the files that the kernel keeps."""
    return int(process(NAME)["VmHWM"].split()[0]) * 1024


def check_a_stack_of_24_megapixels_is_fused_or_refused_in_1_gib():
    with Limited("--memory", "1g", "--memory-swap", "1g") as limited:
        with_profile(limited.service, FULL_SIZE)
        # three at once: only one fits
        jobs = [send(limited.service, FULL_SIZE, f"stack {index}") for index in range(3)]
        for job in jobs:
            job = limited.service.wait(job, timeout_s=300, check=False)
            fault = job.get("error") or {}
            assert job["state"] == "succeeded" or fault.get("code") == "insufficient_storage", job
            assert job["attempt"] == 1, job
        state = inspect(NAME)
        assert not state["State"]["OOMKilled"] and state["RestartCount"] == 0, state["State"]
        assert "memory_mb is lowered" in run("docker", "logs", NAME)
        return f"{job['state']}, peak {peak() >> 20} MiB"


def check_what_does_not_fit_into_the_memory_is_refused_with_figures():
    with Limited("--memory", "400m", "--memory-swap", "400m") as limited:
        with_profile(limited.service, FULL_SIZE)
        job = limited.service.wait(send(limited.service, FULL_SIZE), timeout_s=120, check=False)
        assert (job["state"], job["error"]["code"], job["attempt"]) == ("failed", "insufficient_storage", 1), job
        assert "360 MiB" in job["error"]["detail"], job["error"]
        with_profile(limited.service, SMALL)
        ended(limited.service, send(limited.service, SMALL))
        assert not inspect(NAME)["State"]["OOMKilled"]
        return job["error"]["detail"]


def check_a_job_has_as_many_threads_as_the_container_has_cores():
    told = []
    for cores in sorted({1, min(2, os.cpu_count())}):
        with Limited("--cpus", str(cores)) as limited:
            with_profile(limited.service, LARGE)
            job, most = send(limited.service, LARGE), 0
            tasks = pathlib.Path(f"/proc/{process(NAME)['Pid']}/task")
            while limited.service.get_stack(job)["state"] in ("queued", "running"):
                names = [name.read_text() for name in tasks.glob("*/comm")]
                most = max(most, sum(name.startswith("job-") for name in names))
            ended(limited.service, job)
            assert most == cores, f"{most} threads on {cores} cores"
            told.append(f"{most} of {cores}")
    return ", ".join(told)


def check_a_volume_of_another_owner_is_refused_with_a_sentence():
    foreign = pathlib.Path(os.environ["PINSTACK_CONTAINERS_FOLDER"]) / "foreign"
    foreign.mkdir(mode=0o755)
    with Limited("-v", f"{foreign}:/data"):
        told = log_of_the_end()
    assert "/data" in told and "10001" in told and "chown" in told, told
    return told.splitlines()[-1]


def check_a_full_volume_is_refused_and_told():
    options = ["--opt", "type=tmpfs", "--opt", "device=tmpfs", "--opt", "o=size=64m,uid=10001"]
    run("docker", "volume", "create", *options, "small")
    try:
        with Limited("-v", "small:/data") as limited:
            # the default of min_free_bytes is more than there is
            with_profile(limited.service, SMALL)
            refusal = refused(SMALL)
            assert refusal.code == "insufficient_storage" and "disk" in str(refusal), refusal
            ready = run("curl", "-sS", "-w", "%{http_code}", f"{URL}/readyz")
            assert ready.endswith("503") and "disk" in ready, ready
        # a small stack fits when less must stay free, a large one does not
        with Limited("-v", "small:/data", "-e", "PINSTACK_MIN_FREE_BYTES=1000000") as limited:
            with_profile(limited.service, SMALL)
            ended(limited.service, send(limited.service, SMALL))
            with_profile(limited.service, FULL_SIZE)
            refusal = refused(FULL_SIZE)
            assert refusal.code == "insufficient_storage", refusal
        return str(refusal)
    finally:
        run("docker", "volume", "rm", "-f", "small")


def refused(size):
    """The refusal of a stack, at the first try."""
    try:
        send(client(URL, attempts=1), size)
    except PinstackError as error:
        return error
    raise AssertionError("the stack was accepted")
