"""The commands with frames, datasets and parts on S3, whose server answers 503 now and then."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from fake_frames import ROOT, contents, environment, synth_command

from edgetree import sample_frames


def run(command: list[str], env: dict[str, str]) -> str:
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_shards_of_a_dataset_are_written_to_s3_and_merged(s3: Any, tmp_path: Path) -> None:
    for name in ("numba", "pycocotools"):
        pytest.importorskip(name)
    env = environment(tmp_path)
    run(synth_command(tmp_path / "whole", 12, "--workers", 1), env)
    s3.unavailable_every = 19
    for shard in ("1/2", "2/2"):
        run(synth_command("s3://forest/data", 12, "--shard", shard, "--workers", 2), env)
    merge = [sys.executable, "-m", "perceptree", "merge", "s3://forest/data"]
    run([*merge, "--out", str(tmp_path / "merged")], env)
    assert contents(tmp_path / "merged") == contents(tmp_path / "whole")
    run(merge, env)
    from basetree.jobs import open_store

    labels = open_store("s3://forest/data").read("train_RGB.json")
    assert labels == (tmp_path / "whole" / "train_RGB.json").read_bytes()


def test_frames_on_s3_give_the_rows_of_frames_on_a_disk(s3: Any, tmp_path: Path) -> None:
    from basetree.jobs import copy_folder, open_store

    for number, sample in enumerate(sample_frames()):
        for name, path in (("images", sample.image_path), ("depth", sample.depth_path)):
            (tmp_path / name).mkdir(exist_ok=True)
            (tmp_path / name / f"{number}{path.suffix}").write_bytes(path.read_bytes())
    for name in ("images", "depth"):
        copy_folder(tmp_path / name, open_store(f"s3://forest/{name}"))
    camera = {"schema": "calib.camera/1", **sample_frames()[0].camera.to_dict()}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    tables = []
    s3.unavailable_every = 7
    for place, shards in (
        (str(tmp_path), tmp_path / "parts"),
        ("s3://forest", "s3://forest/parts"),
    ):
        table = tmp_path / f"{len(tables)}.csv"
        command = [sys.executable, "-m", "edgetree", "run", f"{place}/images", "--json"]
        command += ["--depth", f"{place}/depth", "--camera", str(tmp_path / "camera.json")]
        command += ["--threads", "1", "--shards", str(shards), "--csv", str(table)]
        assert json.loads(run(command, env))["frames"] == 6
        tables.append(table.read_bytes())
    assert tables[0] == tables[1]
    assert len(tables[0].splitlines()) > 10
