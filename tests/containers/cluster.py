"""deploy/compose.cluster.yaml: Postgres, API processes, workers, and Caddy for TLS."""

import time
from concurrent.futures import ThreadPoolExecutor

from engine import Compose, hardened, healthy, inspect, run, until
from stacks import LARGE, SMALL, client, ended, send, with_profile

SECRETS = {
    "postgres_password": "secret",
    "database_url": "postgres://pinstack:secret@postgres/pinstack",
}


class Cluster(Compose):
    """The cluster with workers, as the head of its file starts it, and a client behind its proxy."""

    def __init__(self, *more, secrets=None, env=None):
        env = {"DOMAIN": "localhost", **(env or {})}
        super().__init__("compose.cluster.yaml", *more, secrets={**SECRETS, **(secrets or {})}, env=env)

    def __enter__(self):
        # the last line that it prints
        told = self("run", "--rm", "api", "token", "add", "lab", "--scope", "admin")
        self.token = next(word for word in told.split() if word.startswith("pinstack_"))
        self.scale(2)
        # the certificate is Caddy's own
        self.service = client("https://localhost", self.token, verify=False)
        return self

    def scale(self, workers, *options):
        """Starts the cluster with so many workers, or changes their number."""
        self("up", "-d", "--no-build", "--scale", f"worker={workers}", *options)

    def running(self, stack):
        """Waits until a job runs; the worker that has claimed it."""
        until(lambda: self.service.get_stack(stack)["progress"]["fraction"] > 0.05, "the job runs")
        claims = {name: claimed(name, stack) for name in self.containers("worker")}
        return max(claims, key=claims.get)


def claimed(name, stack):
    """When a worker last claimed a job, by its log."""
    lines = [line for line in run("docker", "logs", name).splitlines() if "job claimed" in line and stack["id"] in line]
    return lines[-1].split()[0] if lines else ""


def check_every_process_is_ready_has_no_rights_and_the_data_survive_down_and_up():
    with Cluster() as cluster:
        api = cluster.containers("api")[0]
        seconds = healthy(api)
        for name in [api, *cluster.containers("worker")]:
            hardened(name)
        port = run("curl", "-sSk", "-o", "/dev/null", "-w", "%{http_version} %{http_code}", "https://localhost/readyz")
        assert port == "2 200", port
        with_profile(cluster.service, SMALL)
        stack = ended(cluster.service, send(cluster.service, SMALL))
        image = cluster.service.artifact(stack, "image")
        cluster("down")
        cluster.scale(1)
        assert cluster.service.artifact(stack, "image") == image
        return f"healthy after {seconds:.0f} s"


def check_kills_of_workers_and_of_postgres_in_mid_job_lose_nothing():
    with Cluster() as cluster:
        service = cluster.service
        with_profile(service, LARGE)
        stacks = [send(service, LARGE, f"stack {index}") for index in range(3)]
        worker = cluster.running(stacks[0])
        run("docker", "kill", worker)
        # the others go on while the database is away, and while it is there again
        database = cluster.containers("postgres")[0]
        cluster.running(stacks[1])
        run("docker", "kill", database)
        time.sleep(2)
        run("docker", "start", database, worker)
        attempts = [ended(service, stack)["attempt"] for stack in stacks]
        assert sorted(attempts)[:2] == [1, 1] and max(attempts) <= 2, attempts
        assert {stack["id"] for stack in service.list_stacks()} == {stack["id"] for stack in stacks}
        return f"attempts {attempts}"


def check_stopped_workers_hand_their_jobs_over_and_more_workers_take_some():
    with Cluster() as cluster:
        service = cluster.service
        with_profile(service, LARGE)
        first = send(service, LARGE)
        worker = cluster.running(first)
        began = time.monotonic()
        run("docker", "stop", "-t", "15", worker)
        seconds = time.monotonic() - began
        assert inspect(worker)["State"]["ExitCode"] == 0 and seconds < 15, f"{seconds:.1f} s"
        assert ended(service, first)["attempt"] == 1, "a stop costs no attempt"
        # two replicas more: all four have work
        cluster.scale(4)
        stacks = [send(service, LARGE, f"stack {index}") for index in range(8)]
        for stack in stacks:
            ended(service, stack)
        workers = cluster.containers("worker")
        shares = [sum(bool(claimed(name, stack)) for stack in stacks) for name in workers]
        assert len(workers) == 4 and all(shares), shares
        return f"stopped in {seconds:.1f} s, jobs of each worker {shares}"


def check_an_upgrade_of_one_process_at_a_time_loses_no_request():
    run("docker", "tag", "pinstack", "pinstack:before")
    try:
        with Cluster() as cluster:
            service = cluster.service
            with_profile(service, LARGE)
            with_profile(service, SMALL)
            stacks = [send(service, LARGE, f"stack {index}") for index in range(3)]
            run("docker", "build", "-t", "pinstack", "--label", "next=1", "-", text="FROM pinstack:before\n")
            for name in cluster.containers("worker"):
                run("docker", "rm", "-f", run("docker", "stop", "-t", "15", name))
                cluster.scale(2, "--no-recreate")
                stacks.append(send(service, SMALL, f"beside {name}"))
            impatient = client("https://localhost", cluster.token, attempts=1, verify=False)
            with ThreadPoolExecutor() as other:
                up = ["up", "-d", "--no-build", "--no-deps", "--scale", "worker=2", "api"]
                replaced = other.submit(cluster, *up)
                asked = 0
                # requests wait in the proxy while the API is replaced
                while not replaced.done() or asked < 3:
                    impatient.info()
                    asked += 1
                replaced.result()
            stacks.append(send(impatient, SMALL, "after it"))
            new = inspect("pinstack")["Id"]
            for name in cluster.containers("worker") + cluster.containers("api"):
                assert inspect(name)["Image"] == new, f"{name} is old"
            attempts = [ended(service, stack)["attempt"] for stack in stacks]
            assert attempts == [1] * len(stacks), attempts
            return f"{asked} requests while the API was replaced"
    finally:
        run("docker", "tag", "pinstack:before", "pinstack")
