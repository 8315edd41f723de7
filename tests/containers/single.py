"""deploy/compose.yaml: one machine, embedded store."""

import datetime
import json
import time

from engine import Compose, hardened, healthy, inspect, run, until
from stacks import LARGE, SMALL, client, ended, send, with_profile

NAME = "test_pinstack_1"


def logs(name):
    """The lines of the log, as JSON where they are."""
    return run("docker", "logs", name).splitlines()


def check_it_is_healthy_in_seconds_has_no_rights_and_its_data_survive_down_and_up():
    with Compose("compose.yaml") as compose:
        compose("up", "-d", "--no-build")
        seconds = healthy(NAME)
        assert seconds < 15, f"healthy after {seconds:.0f} s"
        hardened(NAME)
        service = client()
        with_profile(service, SMALL)
        stack = ended(service, send(service, SMALL))
        image, identity = service.artifact(stack, "image"), service.info()["id"]
        compose("down")
        compose("up", "-d", "--no-build")
        assert service.info()["id"] == identity
        assert service.artifact(stack, "image") == image
        return f"healthy after {seconds:.0f} s"


def check_a_kill_in_mid_job_loses_nothing():
    with Compose("compose.yaml") as compose:
        compose("up", "-d", "--no-build")
        service = client()
        with_profile(service, LARGE)
        stack = send(service, LARGE)
        until(lambda: service.get_stack(stack)["progress"]["fraction"] > 0.1, "the job runs")
        run("docker", "kill", NAME)
        run("docker", "start", NAME)
        began = time.monotonic()
        stack = ended(service, stack)
        assert stack["attempt"] == 2, stack
        return f"fused {time.monotonic() - began:.0f} s after the start"


def check_stop_ends_in_time_and_the_job_continues_afterwards():
    with Compose("compose.yaml") as compose:
        compose("up", "-d", "--no-build")
        service = client()
        with_profile(service, LARGE)
        stacks = [send(service, LARGE, f"stack {index}") for index in range(3)]
        until(lambda: service.get_stack(stacks[0])["progress"]["fraction"] > 0.1, "the job runs")
        began = time.monotonic()
        compose("stop")
        seconds = time.monotonic() - began
        state = inspect(NAME)["State"]
        assert state["ExitCode"] == 0 and not state["OOMKilled"], state
        assert seconds < 15, f"{seconds:.1f} s: Docker killed it"
        compose("start")
        for stack in stacks:
            assert ended(service, stack)["attempt"] == 1, "a stop costs no attempt"
        return f"stopped in {seconds:.1f} s"


def check_an_upgrade_keeps_the_data_and_the_health():
    with Compose("compose.yaml") as compose:
        compose("up", "-d", "--no-build")
        service = client()
        with_profile(service, SMALL)
        stack = ended(service, send(service, SMALL))
        old = inspect(NAME)["Image"]
        run("docker", "tag", "pinstack", "pinstack:before")
        try:
            run("docker", "build", "-t", "pinstack", "--label", "next=1", "-", text="FROM pinstack:before\n")
            compose("up", "-d", "--no-build")
            assert inspect(NAME)["Image"] != old, "compose starts the new image"
            healthy(NAME)
            assert service.get_stack(stack)["state"] == "succeeded"
        finally:
            run("docker", "tag", "pinstack:before", "pinstack")


def check_the_log_is_json_and_times_are_those_of_utc():
    options = ["-e", "PINSTACK_AUTH=none", "-e", "PINSTACK_LOG_FORMAT=json", "-e", "TZ=Pacific/Auckland"]
    run("docker", "run", "-d", "--name", "json", "-p", "127.0.0.1:8081:8080", *options, "pinstack")
    try:
        service = client("http://127.0.0.1:8081")
        with_profile(service, SMALL)
        stack = ended(service, send(service, SMALL))
        lines = [json.loads(line) for line in logs("json")]
    finally:
        run("docker", "rm", "-fv", "json")
    now = datetime.datetime.now(datetime.UTC)
    times = [line["timestamp"] for line in lines] + [stack["created_at"], stack["finished_at"]]
    for text in times:
        age = now - datetime.datetime.fromisoformat(text)
        assert text.endswith("Z") and datetime.timedelta() <= age < datetime.timedelta(minutes=5), text
    assert any(stack["id"] in json.dumps(line) for line in lines), "the job is in the log"
    return f"{len(lines)} lines"
