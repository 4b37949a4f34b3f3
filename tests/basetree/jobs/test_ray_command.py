"""`--ray` on the commands: the data of one machine, and one line if Ray is not installed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from fake_frames import ROOT, contents, environment, synth_command


def run(command: list[str], env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, env=env, capture_output=True, text=True, check=False)


def test_without_the_extra_one_line_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "ray.py").write_text("raise ModuleNotFoundError('no ray', name='ray')")
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    source = ROOT / "edgetree" / "assets" / "samples"
    command = [
        sys.executable,
        "-m",
        "edgetree",
        "run",
        str(source),
        "--shards",
        str(tmp_path / "p"),
    ]
    done = run([*command, "--model", "rgb", "--ray", "local"], env)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == (
        'edgetree: --ray needs the package ray: install it with pip install ".[fleet]"'
    )
    assert done.stdout == ""


def test_nothing_of_the_extra_is_loaded_without_its_options(tmp_path: Path) -> None:
    code = (
        "import sys, fleet, edgetree.cli\n"
        "loaded = {name.partition('.')[0] for name in sys.modules}\n"
        "print({'ray', 'fsspec', 's3fs', 'boto3'} & loaded)"
    )
    done = run([sys.executable, "-c", code], {**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.stdout == "set()\n"


def test_ray_on_this_machine_makes_the_data_of_one_machine(tmp_path: Path) -> None:
    for name in ("ray", "numba", "pycocotools"):
        pytest.importorskip(name)
    env = environment(tmp_path)
    whole, rayed = tmp_path / "whole", tmp_path / "rayed"
    assert run(synth_command(whole, 12, "--workers", 1), env).returncode == 0
    done = run(synth_command(rayed, 12, "--ray", "local"), env)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0].startswith("train: ")
    assert "simulating: 12 of 12 frames" in done.stderr
    assert contents(rayed) == contents(whole)


def test_an_address_without_a_cluster_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    for name in ("numba", "pycocotools"):
        pytest.importorskip(name)
    env = {**environment(tmp_path), "RAY_raylet_start_wait_time_s": "1"}
    done = run(synth_command(tmp_path / "out", 12, "--ray", "no port"), env)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("perceptree: --ray is 'no port': no cluster")
