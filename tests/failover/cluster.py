"""A cluster of `semmap db cluster` in Docker, and what can happen to its containers."""

from __future__ import annotations

import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from random import randrange

import psycopg
import yaml

from semmap.database.failover import write_cluster
from tests.failover.writers import TABLES

COMPOSE = """
FROM debian:bookworm-slim
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends docker-compose
"""
STATES = "SELECT nodename, reportedstate::text, goalstate::text FROM pgautofailover.node"


def run(*command: str, text: str | None = None) -> str:
    """What a program prints; an error if it fails."""
    done = subprocess.run(command, input=text, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stdout}{done.stderr}"
    return done.stdout.strip()


def compose_command(folder: Path) -> list[str]:
    """`docker compose`, in a container where this machine has none."""
    with suppress(AssertionError):
        run("docker", "compose", "version")
        return ["docker", "compose"]
    if program := shutil.which("docker-compose"):
        return [program]
    image = "semmap-compose:test"
    run("docker", "build", "--network", "host", "-q", "-t", image, "-", text=COMPOSE)
    mounts = ["-v", "/var/run/docker.sock:/var/run/docker.sock", "-v", f"{folder}:{folder}"]
    engine_builds = ["-e", "COMPOSE_DOCKER_CLI_BUILD=0"]  # the image has no program docker
    options = ["--rm", *mounts, *engine_builds, "-w", str(folder)]
    return ["docker", "run", *options, image, "docker-compose"]


def free_ports(count: int) -> int:
    """The first of some ports in a row that nothing uses."""
    while True:
        first = randrange(20000, 30000)
        try:
            for port in range(first, first + count):
                with socket.socket() as taken:
                    taken.bind(("127.0.0.1", port))
        except OSError:
            continue
        return first


def loop_device(file: Path, megabytes: int = 1500) -> str:
    """A small disk in a file. Needs root."""
    with file.open("wb") as disk:
        disk.truncate(megabytes << 20)
    run("mkfs.ext4", "-q", str(file))
    return run("losetup", "--find", "--show", str(file))


class FailoverCluster:
    """Servers and a monitor; its servers are named node1, node2, ..."""

    def __init__(self, folder: Path, nodes: int = 3, small_disks: tuple[str, ...] = ()) -> None:
        self.written = write_cluster(folder, nodes=nodes, port=free_ports(nodes))
        self.url = self.written.url
        self.folder = folder
        self.nodes = [f"node{i + 1}" for i in range(nodes)]
        services = yaml.safe_load((folder / "compose.yaml").read_text())["services"]
        self.addresses = {
            name: service["networks"]["nodes"]["ipv4_address"] for name, service in services.items()
        }
        with (folder / ".env").open("a") as variables:
            variables.write("SEMMAP_IMAGE=semmap-postgis:test\n")
        self.small = small_disks
        self._disks = {name: loop_device(folder / f"{name}.disk") for name in small_disks}
        volumes = {
            name: {"driver": "local", "driver_opts": {"type": "ext4", "device": device}}
            for name, device in self._disks.items()
        }
        files = ["compose.yaml"]
        if volumes:
            files.append("disks.yaml")
            (folder / "disks.yaml").write_text(yaml.safe_dump({"volumes": volumes}))
        self._compose = [*compose_command(folder), "--project-directory", str(folder)]
        for file in files:
            self._compose += ["-f", str(folder / file)]

    def url_of(self, name: str) -> str:
        """The URL of one server."""
        hosts = self.url.split("@")[1].split("/")[0]
        return self.url.replace(hosts, hosts.split(",")[self.nodes.index(name)])

    def compose(self, *arguments: str) -> str:
        """Run `docker compose` with the files."""
        return run(*self._compose, *arguments)

    def start(self) -> None:
        """Build the image, start the containers and wait until a standby follows."""
        self.compose("up", "-d", "--build")
        self.wait_until_ready()
        with psycopg.connect(self.url) as connection:
            connection.execute(TABLES)

    def remove(self) -> None:
        """Delete the containers with their data."""
        self.compose("down", "-v", "-t", "1")
        for device in self._disks.values():
            run("losetup", "-d", device)

    def container(self, name: str) -> str:
        """The container's id of a service."""
        labels = {"project": self.folder.name.lower(), "service": name}
        filters = [f"--filter=label=com.docker.compose.{key}={labels[key]}" for key in labels]
        return run("docker", "ps", "-a", "-q", *filters)

    def execute(self, name: str, *command: str) -> str:
        """Run a command in a container, as the server's user."""
        return run("docker", "exec", "-u", "postgres", self.container(name), *command)

    def states(self) -> dict[str, tuple[str, str]]:
        """For each server the state that it reported, and the one that the monitor assigned."""
        rows = self.execute("monitor", "psql", "-XAt", "-d", "pg_auto_failover", "-c", STATES)
        return {name: (now, goal) for name, now, goal in map(_fields, rows.splitlines())}

    def primary(self) -> str:
        """The server that takes writes."""
        return next(name for name, (_, goal) in self.states().items() if goal == "primary")

    def standbys(self) -> list[str]:
        """The servers that follow."""
        return [name for name, (_, goal) in self.states().items() if goal == "secondary"]

    def wait_until_ready(self, seconds: float = 120) -> None:
        """Wait until there is a primary, and all others follow it."""
        wanted = sorted(["primary", *["secondary"] * (len(self.nodes) - 1)])
        deadline = time.monotonic() + seconds
        states: dict[str, tuple[str, str]] = {}
        while time.monotonic() < deadline:
            with suppress(AssertionError):
                states = self.states()
            if (
                wanted
                == sorted(now for now, _ in states.values())
                == sorted(goal for _, goal in states.values())
            ):
                return
            time.sleep(0.3)
        raise TimeoutError(f"after {seconds} s the servers are {states}")

    def kill(self, name: str) -> None:
        """Kill a container at once; it stays down."""
        run("docker", "kill", "-s", "KILL", self.container(name))

    def revive(self, name: str) -> None:
        """Start a container that is down."""
        run("docker", "start", self.container(name))

    def pause(self, name: str) -> None:
        """Stop a server's processes where they are; connections stay open.

        `docker pause` needs a control group that not each machine has.
        """
        self.execute(name, "bash", "-c", "kill -STOP -1")

    def resume(self, name: str) -> None:
        """Let a server's processes go on."""
        self.execute(name, "bash", "-c", "kill -CONT -1")

    def fill(self, name: str) -> None:
        """Write a file until the disk of a server is full."""
        self.execute(name, "bash", "-c", "cat /dev/zero >$PGDATA/../filler 2>/dev/null || true")

    def make_room(self, name: str) -> None:
        """Delete that file."""
        self.execute(name, "bash", "-c", "rm $PGDATA/../filler")

    @contextmanager
    def cut_off(self, name: str) -> Iterator[None]:
        """Drop all packets between a server and the others; clients still reach it. Needs root."""
        address = self.addresses[name]
        subnet = f"{address.rsplit('.', 1)[0]}.0/24"
        rules = [["-s", address, "-d", subnet], ["-d", address, "-s", subnet]]
        for rule in rules:
            run("iptables", "-I", "FORWARD", *rule, "-j", "DROP")
        try:
            yield
        finally:
            for rule in rules:
                run("iptables", "-D", "FORWARD", *rule, "-j", "DROP")


def _fields(line: str) -> tuple[str, str, str]:
    name, now, goal = line.split("|")
    return name, now, goal


@contextmanager
def running_cluster(nodes: int = 3, small_disks: tuple[str, ...] = ()) -> Iterator[FailoverCluster]:
    """A cluster in a new folder, removed at the end."""
    folder = Path(tempfile.mkdtemp(prefix="semmap-failover-", dir="/tmp"))
    cluster = FailoverCluster(folder, nodes, small_disks)
    try:
        cluster.start()
        yield cluster
    finally:
        cluster.remove()
        shutil.rmtree(folder)
