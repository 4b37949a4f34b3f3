"""Faults on a cluster of two nodes: the data is that of an undisturbed run, byte for byte."""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from fake_frames import contents, environment, synth_command

pytestmark = pytest.mark.slow
FRAMES = 120
FRAME_SECONDS = 0.25
ENDS_S = 400


@pytest.fixture
def whole(tmp_path: Path) -> dict[str, bytes]:
    """The dataset that one machine makes."""
    out = tmp_path / "whole"
    env = environment(tmp_path)
    subprocess.run(synth_command(out, FRAMES, "--workers", 1), env=env, check=True)
    return contents(out)


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A cluster of a node that computes nothing and two nodes of one core, on this machine."""
    pytest.importorskip("ray")
    for name, value in environment(tmp_path, FRAME_SECONDS).items():
        monkeypatch.setenv(name, value)
    from ray.cluster_utils import Cluster

    small = {"object_store_memory": 100 * 2**20, "include_dashboard": False}
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **small})
    cluster.nodes = [add_node(cluster) for _ in range(2)]
    yield cluster
    cluster.shutdown()


def add_node(cluster: Any) -> Any:
    """Add a node of one core."""
    return cluster.add_node(num_cpus=1, object_store_memory=100 * 2**20)


def worker_ids(cluster: Any) -> list[int]:
    """Ids of the processes that nodes of this cluster have started to work."""
    raylets = {
        process.process.pid
        for node in cluster.list_all_nodes()
        for process in node.all_processes.get("raylet", [])
    }
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with suppress(OSError):
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                name = (folder / "cmdline").read_text()
                # The others are agents, which end their node with them.
                if parent in raylets and name.startswith(("ray::work", "ray::IDLE")):
                    found.append(int(folder.name))
    return found


def parts(out: Path) -> int:
    """Number of finished scenes."""
    return len(list((out / "scenes").glob("*.json")))


def until(condition: Callable[[], bool], driver: subprocess.Popen[str]) -> None:
    """Wait for a condition while a command runs."""
    end_s = time.monotonic() + ENDS_S
    while not condition():
        assert driver.poll() is None, driver.communicate()
        assert time.monotonic() < end_s
        time.sleep(0.1)


@pytest.fixture
def start(cluster: Any) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts ``perceptree synth`` on the cluster."""
    started: list[subprocess.Popen[str]] = []

    def run(out: object) -> subprocess.Popen[str]:
        command = synth_command(out, FRAMES, "--ray", cluster.address)
        pipe = subprocess.PIPE
        started.append(subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True))
        return started[-1]

    yield run
    for process in started:
        process.kill()


def finish(driver: subprocess.Popen[str]) -> str:
    """Wait for a command to succeed; returns what it told."""
    _, told = driver.communicate(timeout=ENDS_S)
    assert driver.returncode == 0, told
    return told


def test_twenty_killed_workers_change_nothing(
    cluster: Any,
    start: Callable[..., subprocess.Popen[str]],
    tmp_path: Path,
    whole: dict[str, bytes],
) -> None:
    driver, killed, rng = start(tmp_path / "out"), 0, random.Random(5)
    until(lambda: parts(tmp_path / "out") > 0, driver)
    while killed < 20 and driver.poll() is None:
        time.sleep(rng.uniform(0.3, 1.5))
        if workers := worker_ids(cluster):
            with suppress(ProcessLookupError):
                os.kill(rng.choice(workers), signal.SIGKILL)
                killed += 1
    told = finish(driver)
    assert killed == 20
    assert "a worker was lost" in told
    assert contents(tmp_path / "out") == whole


def test_killed_workers_change_no_row_of_measured_frames(cluster: Any, tmp_path: Path) -> None:
    from edgetree import sample_frames

    for number in range(320):
        sample = sample_frames()[number % len(sample_frames())]
        for name, path in (("images", sample.image_path), ("depth", sample.depth_path)):
            (tmp_path / name).mkdir(exist_ok=True)
            (tmp_path / name / f"{number}{path.suffix}").symlink_to(path)
    command = [sys.executable, "-m", "edgetree", "run", str(tmp_path / "images"), "--threads", "1"]
    command += ["--depth", str(tmp_path / "depth")]
    whole, merged = tmp_path / "whole.csv", tmp_path / "merged.csv"
    subprocess.run([*command, "--csv", str(whole), "--json"], check=True, stdout=subprocess.DEVNULL)
    parts = tmp_path / "parts"
    command += ["--shards", str(parts), "--ray", cluster.address, "--csv", str(merged), "--json"]
    pipe = subprocess.PIPE
    driver, killed = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True), 0
    until(lambda: len(list(parts.glob("parts/*.json"))) > 0, driver)
    while killed < 5 and driver.poll() is None:
        time.sleep(2.5)
        for worker in worker_ids(cluster)[:1]:
            with suppress(ProcessLookupError):
                os.kill(worker, signal.SIGKILL)
                killed += 1
    finish(driver)
    assert killed >= 2
    assert merged.read_bytes() == whole.read_bytes()


def test_a_node_that_leaves_and_one_that_joins_change_nothing(
    cluster: Any,
    start: Callable[..., subprocess.Popen[str]],
    tmp_path: Path,
    whole: dict[str, bytes],
) -> None:
    driver = start(tmp_path / "out")
    until(lambda: parts(tmp_path / "out") >= 5, driver)
    cluster.remove_node(cluster.nodes[0], allow_graceful=False)
    until(lambda: parts(tmp_path / "out") >= 15, driver)
    cluster.remove_node(cluster.nodes[1], allow_graceful=False)
    time.sleep(5)
    before = parts(tmp_path / "out")
    add_node(cluster)
    until(lambda: parts(tmp_path / "out") > before + 5, driver)
    told = finish(driver)
    assert "a worker was lost (NodeDiedError): its work is done again" in told
    assert contents(tmp_path / "out") == whole


def test_a_killed_driver_goes_on_where_it_was(
    cluster: Any,
    start: Callable[..., subprocess.Popen[str]],
    tmp_path: Path,
    whole: dict[str, bytes],
) -> None:
    driver = start(tmp_path / "out")
    until(lambda: parts(tmp_path / "out") >= 10, driver)
    driver.kill()
    driver.wait()
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "scenes").iterdir()}
    told = finish(start(tmp_path / "out"))
    assert "frames are finished from an earlier run" in told
    assert {path: path.stat().st_mtime_ns for path in times} == times
    assert contents(tmp_path / "out") == whole


def test_an_object_store_that_fails_and_fills_up_changes_nothing(
    s3: Any,
    cluster: Any,
    start: Callable[..., subprocess.Popen[str]],
    tmp_path: Path,
    whole: dict[str, bytes],
) -> None:
    s3.unavailable_every = 23
    driver = start("s3://forest/data")
    until(lambda: sum("PUT /forest/data/scenes/" in line for line in s3.requests) > 10, driver)
    s3.is_full = True
    _, told = driver.communicate(timeout=ENDS_S)
    assert driver.returncode == 2
    assert "no space left in the store; finished parts are kept" in told.splitlines()[-1]
    s3.is_full = False
    told = finish(start("s3://forest/data"))
    assert "frames are finished from an earlier run" in told
    from basetree.jobs import fetch, open_store

    store = open_store("s3://forest/data")
    folders = ("", "images", "depth", "depth8", "depth_exact", "scenes")
    names = [name for folder in folders for name in store.sizes(folder)]
    fetch(store, names, tmp_path / "fetched")
    assert contents(tmp_path / "fetched") == whole
