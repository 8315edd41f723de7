"""A Docker engine for one run: its images, its containers, and compose."""

import json
import os
import pathlib
import re
import shutil
import subprocess
import time

ROOT = pathlib.Path(__file__).parents[2]
BINARY = pathlib.Path(os.environ.pop("PINSTACK_CONTAINERS_BINARY"))
WHOLE = bool(os.environ.pop("PINSTACK_CONTAINERS_WHOLE"))
TREE = os.environ.pop("PINSTACK_CONTAINERS_TREE")

# What the images of the registries do with the same programs; the tree of packages is below each.
STAND_INS = {
    "postgres": """
ENV PGDATA=/var/lib/postgresql/data PATH=/usr/lib/postgresql/15/bin:$PATH
COPY postgres.sh /
ENTRYPOINT ["/postgres.sh"]
STOPSIGNAL SIGINT
""",
    "caddy": """
ENV XDG_DATA_HOME=/data XDG_CONFIG_HOME=/config
CMD ["caddy", "run", "--config", "/etc/caddy/Caddyfile", "--adapter", "caddyfile"]
""",
    "garage": 'COPY garage /garage\nCMD ["/garage", "server"]\n',
}
POSTGRES = """#!/bin/sh
set -e
mkdir -p "$PGDATA" && chown postgres "$PGDATA" && chmod 700 "$PGDATA"
as="setpriv --reuid=postgres --regid=postgres --clear-groups"
if [ ! -s "$PGDATA/PG_VERSION" ]; then
  install -o postgres -m 600 "$POSTGRES_PASSWORD_FILE" /tmp/password
  $as initdb -U "$POSTGRES_USER" --pwfile=/tmp/password -A scram-sha-256 --auth-local=trust >/dev/null
  rm /tmp/password
  echo "host all all all scram-sha-256" >>"$PGDATA/pg_hba.conf"
  echo "CREATE DATABASE $POSTGRES_DB" | $as postgres --single -D "$PGDATA" postgres >/dev/null
fi
exec $as postgres -c listen_addresses='*'
"""


def run(*command, env=None, check=True, text=None):
    """What a program prints; both streams, and an error with them if it fails."""
    done = subprocess.run(
        [str(word) for word in command],
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL if text is None else None,
        input=text,
        text=True,
        errors="replace",
        env={**os.environ, **(env or {})},
    )
    if check and done.returncode:
        raise AssertionError(f"{' '.join(map(str, command))}: {done.returncode}\n{done.stdout[-4000:]}")
    return done.stdout.strip()


def until(condition, what, seconds=60):
    """Waits for a condition; what it returned, and the seconds that it took."""
    began = time.monotonic()
    while time.monotonic() < began + seconds:
        if value := condition():
            return value, time.monotonic() - began
        time.sleep(0.05)
    raise AssertionError(f"not within {seconds} s: {what}")


class Engine:
    """dockerd in the namespaces of this process."""

    def __init__(self, folder, group):
        self.folder = pathlib.Path(folder)
        os.environ["DOCKER_HOST"] = f"unix://{self.folder}/sock"
        # the engine of Debian has no BuildKit, which newer clients would ask for; what the Dockerfile promises to need
        os.environ["DOCKER_BUILDKIT"] = "0"
        run("ip", "link", "set", "lo", "up")
        options = ["--data-root", self.folder / "data", "--exec-root", self.folder / "exec"]
        options += ["--pidfile", self.folder / "pid", "-H", os.environ["DOCKER_HOST"], "--cgroup-parent", f"/{group}"]
        with open(self.folder / "dockerd.log", "w") as log:
            subprocess.Popen(["dockerd", *map(str, options)], stdout=log, stderr=log)
        try:
            until(lambda: "Server Version" in run("docker", "info", check=False), "dockerd starts", 30)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{(self.folder / 'dockerd.log').read_text()[-3000:]}") from None

    def images(self):
        """Builds every image that the Dockerfile and the compose files name."""
        dockerfile = (ROOT / "Dockerfile").read_text()
        base = re.search(r"^ARG RUST_IMAGE=docker.io/library/(.*)$", dockerfile, re.MULTILINE)[1]
        run("docker", "import", TREE, base)
        if WHOLE:
            self.compiler(base)
            run("docker", "build", "-t", "pinstack", ROOT)
        else:
            # the binary in place of the stage `build`, as scripts/release/image.sh puts it
            before, rest = dockerfile.split("FROM ${RUST_IMAGE} AS build\n")
            _, after = rest.split("\n# What the binary needs and nothing else:")
            context = self.folder / "image"
            context.mkdir()
            for name in ["LICENSE", "LICENSE-APACHE", "LICENSE-MIT"]:
                shutil.copy(ROOT / name, context)
            shutil.copy(BINARY, context / "pinstack")
            stage = "FROM ${RUST_IMAGE} AS build\nCOPY pinstack LICENSE /src/target/release/\n"
            stage += "RUN mv /src/target/release/LICENSE /src/target/THIRD-PARTY.txt\n# What the binary needs:"
            (context / "Dockerfile").write_text(before + stage + after)
            run("docker", "build", "-t", "pinstack", context)
        compose = "".join(path.read_text() for path in (ROOT / "deploy").glob("compose*.yaml"))
        for name in re.findall(r"^ +image: docker\.io/(?:library/)?(\S+)$", compose, re.MULTILINE):
            kind = re.split("[/:]", name.removeprefix("dxflrs/"))[0]
            context = self.folder / kind
            context.mkdir()
            (context / "postgres.sh").write_text(POSTGRES)
            (context / "postgres.sh").chmod(0o755)
            if kind == "garage":
                shutil.copy(shutil.which("garage"), context)
            (context / "Dockerfile").write_text(f"FROM {base}\n{STAND_INS[kind]}")
            run("docker", "build", "-t", name, context)

    def compiler(self, base):
        """Puts the toolchain and the crates of this machine into the base image: nothing is fetched from a container."""
        context = self.folder / "compiler"
        (context / "cargo/registry").mkdir(parents=True)
        toolchain = pathlib.Path(run("rustc", "--print", "sysroot")).resolve()
        home = pathlib.Path(os.environ.get("CARGO_HOME", pathlib.Path.home() / ".cargo"))
        for part in ["index", "cache"]:
            run("cp", "-r", home / "registry" / part, context / "cargo/registry")
        (context / "rust").mkdir()
        run("cp", "-r", toolchain / "bin", toolchain / "lib", context / "rust")
        (context / "Dockerfile").write_text(
            f"FROM {base}\nCOPY rust /usr/local\nCOPY cargo /cargo\nENV CARGO_HOME=/cargo CARGO_NET_OFFLINE=true\n"
        )
        run("docker", "build", "-t", base, context)


def inspect(name):
    """The state of a container."""
    return json.loads(run("docker", "inspect", name))[0]


def healthy(name, seconds=30):
    """Waits for the health check of a container; seconds since its start."""
    return until(
        lambda: inspect(name)["State"].get("Health", {}).get("Status") == "healthy", f"{name} healthy", seconds
    )[1]


def process(name):
    """The first process of a container, as the kernel shows it: the lines of `status` as a dictionary."""
    number = inspect(name)["State"]["Pid"]
    lines = pathlib.Path(f"/proc/{number}/status").read_text().splitlines()
    return {"Pid": number, **dict(line.split(":\t", 1) for line in lines if ":\t" in line)}


TARGET = ["--pitch-mm", "2", "--columns", "9", "--rows", "9", "--out", "/usr/target.pdf"]


def hardened(name):
    """Fails unless a container runs as another user than root, without rights, on a root that cannot be written."""
    status, config = process(name), inspect(name)["HostConfig"]
    assert set(status["Uid"].split()) == {"10001"}, status["Uid"]
    assert int(status["CapEff"], 16) == int(status["CapPrm"], 16) == int(status["CapBnd"], 16) == 0, status
    assert status["NoNewPrivs"] == "1", status
    assert config["ReadonlyRootfs"] and not config["Privileged"], config
    # a root that can be written would show this file
    told = run("docker", "exec", name, "pinstack", "target", *TARGET, check=False)
    assert "ead-only" in told, told


class Compose:
    """Files of deploy/, started as one project; `secrets` are files of deploy/secrets."""

    def __init__(self, *files, secrets=None, env=None):
        # below a copy, so that nothing appears in the working tree
        self.folder = pathlib.Path(os.environ["PINSTACK_CONTAINERS_FOLDER"]) / f"project-{files[-1]}"
        shutil.copytree(ROOT / "deploy", self.folder / "deploy", ignore=shutil.ignore_patterns("secrets"))
        (self.folder / "deploy/secrets").mkdir(mode=0o700)
        for name, text in (secrets or {}).items():
            (self.folder / "deploy/secrets" / name).write_text(text)
        self.files, self.env = files, env or {}

    def __call__(self, *words, check=True):
        files = [word for name in self.files for word in ("-f", self.folder / "deploy" / name)]
        return run("docker-compose", "-p", "test", *files, *words, env=self.env, check=check)

    def containers(self, service):
        """Names of the running containers of a service."""
        labels = ["label=com.docker.compose.project=test", f"label=com.docker.compose.service={service}"]
        labels.append("label=com.docker.compose.oneoff=False")
        filters = [word for label in labels for word in ("--filter", label)]
        return sorted(run("docker", "ps", *filters, "--format", "{{.Names}}").split())

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if kind:
            print(self("logs", "--tail=30", check=False)[-8000:])
        self("down", "-v", "--remove-orphans", "-t", "2", check=False)
        shutil.rmtree(self.folder)
