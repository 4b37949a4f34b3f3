"""JSON Schemas: real output of the commands is valid, and has no key that they do not name."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from schema_check import check_schema

import calib
from calib.depth_scale import DepthScale
from edgetree.catalogue import KnownModel, default_model
from edgetree.frames.frame import DepthNoise
from edgetree.model_file.manifest import METADATA_KEY
from edgetree.model_file.safety_check import read_model_file
from edgetree.results.service_state import ServiceState, state_message
from edgetree.sample_files import write_samples
from edgetree.schemas import json_schema, schema_names
from edgetree.signing.envelope import Envelope
from edgetree.signing.statement import Statement
from edgetree.signing.trust import TrustedKey, TrustFile, write_trust_file
from edgetree.signing.used_versions import record_time
from edgetree.sources.bags.exact import exact_record

jsonschema = pytest.importorskip("jsonschema")
Cli = Callable[..., Any]
ROOT = Path(__file__).resolve().parents[3]

NOT_DESCRIBED = {
    *("edgetree.eval/1", "edgetree.verify/1"),
}


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples") / "samples"
    write_samples(folder)
    return folder


@pytest.mark.parametrize("name", schema_names())
def test_each_schema_is_one(name: str) -> None:
    schema = json_schema(name)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    jsonschema.Draft202012Validator.check_schema(schema)


def test_the_command_prints_a_schema_and_lists_the_names(run_cli: Cli) -> None:
    assert tuple(run_cli("schema").out.split()) == schema_names()
    assert json.loads(run_cli("schema", "edgetree.frame").out)["title"] == "edgetree.frame/1"
    done = run_cli("schema", "edgetree.frames")
    assert done.code == 2
    assert "schema 'edgetree.frames' is unknown: expected one of calib.camera/1" in done.err


def test_every_format_is_described_or_listed_as_not() -> None:
    named = set()
    for package in ("calib", "edgetree", "basetree"):
        for path in (ROOT / package).rglob("*.py"):
            named |= set(
                re.findall(r'"((?:edgetree|calib)\.[a-z_.-]+/\d+)"', path.read_text("utf-8"))
            )
    assert named - set(schema_names()) <= NOT_DESCRIBED
    without_key = {"calib.found-labels/1", "edgetree.signature-file/1"}
    assert set(schema_names()) - without_key <= named
    assert not set(schema_names()) & NOT_DESCRIBED


def test_results_of_run_measure_and_check_are_valid(
    run_cli: Cli, samples: Path, tmp_path: Path
) -> None:
    rig = ("--camera", samples / "camera.json", "--json")
    depth = samples / "depth"
    picture = ("measure", samples / "pictures" / "sample_0.jpg", "--depth", depth / "sample_0.png")
    records = [json.loads(run_cli(*picture, *rig, "--species", "pine").out)]
    table = tmp_path / "trees.csv"
    frames = ("run", samples / "pictures" / "sample_*.jpg", "--depth", depth, "--csv", table)
    records.append(json.loads(run_cli(*frames, *rig).out))
    done = run_cli("check", table, samples / "caliper.csv", "--out", tmp_path / "check", "--json")
    records += [
        json.loads(done.out),
        json.loads((tmp_path / "check" / "settings.json").read_text()),
    ]
    records += records[1]["frames"]
    assert [check_schema(record) for record in records][:4] == [
        *("edgetree.measure/1", "edgetree.run/1", "edgetree.check/1", "edgetree.check_settings/1"),
    ]


def test_frames_without_metres_are_valid(run_cli: Cli, images: Path, model: Path) -> None:
    for line in run_cli("run", images, "--model", model).out.splitlines():
        assert check_schema(json.loads(line)) == "edgetree.frame/1"


def test_live_results_and_their_map_are_valid(run_cli: Cli, samples: Path, tmp_path: Path) -> None:
    lines, stems = tmp_path / "live.jsonl", tmp_path / "stems.geojson"
    done = run_cli("live", samples / "drive", "--jsonl", lines, "--map", stems, "--frames", 6)
    assert done.code == 0, done.err
    records = [json.loads(line) for line in lines.read_text().splitlines()]
    assert records[-1]["tracks"]
    assert {check_schema(record) for record in records} == {"edgetree.live/1"}
    assert check_schema(json.loads(stems.read_text())) == "edgetree.live.map/1"


def test_the_list_of_models_and_their_manifests_are_valid(run_cli: Cli) -> None:
    assert check_schema(json.loads(run_cli("models", "--json").out)) == "edgetree.models/1"
    record = json.loads(read_model_file(default_model("depth")).metadata[METADATA_KEY])
    assert check_schema(record) == METADATA_KEY + "/1"


def test_the_verification_of_an_older_file_is_valid() -> None:
    pytest.importorskip("torch")
    from edgetree.commands.export import record
    from edgetree.export import ExportReport, ParityReport

    manifest = KnownModel("depth", default_model("depth")).manifest()
    older = dataclasses.replace(manifest, proposals=None, multiply_adds=None)
    report = ExportReport(default_model("depth"), older, ParityReport("int8", ()), 1)
    assert check_schema(json.loads(json.dumps(record(report)))) == "edgetree.export/1"


def test_cards_are_valid_and_a_card_without_a_speed_is_not() -> None:
    for card in sorted(ROOT.glob("edgetree/assets/models/*.json")):
        record = json.loads(card.read_text())
        assert check_schema(record) == "edgetree.card/1"
    del record["speed"]
    with pytest.raises(jsonschema.ValidationError):
        check_schema(record)


def test_a_stored_benchmark_is_valid() -> None:
    record = json.loads((ROOT / "benchmarks/results/bench.json").read_text())
    assert check_schema(record) == "edgetree.bench/2"


def test_found_labels_and_signatures_are_valid(
    run_cli: Cli, images: Path, model: Path, tmp_path: Path
) -> None:
    done = run_cli("run", images, "--model", model, "--coco", tmp_path / "found.json")
    assert done.code == 0, done.err
    check_schema(json.loads((tmp_path / "found.json").read_text()), "calib.found-labels/1")
    envelope = Envelope(b"{}", "key", b"signed").to_json()
    check_schema(json.loads(envelope), "edgetree.signature-file/1")


def test_a_recording_says_of_its_run_what_the_schema_names(
    run_cli: Cli, samples: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    mcap = pytest.importorskip("mcap.reader")
    recordings = ("--record", tmp_path / "kept", "--record-all", "--frames", 2)
    done = run_cli("live", samples / "drive", *recordings)
    assert done.code == 0, done.err
    (bag,) = (tmp_path / "kept").rglob("*.mcap")
    with bag.open("rb") as stream:
        found = list(mcap.make_reader(stream).iter_messages(topics=["/edgetree/recording"]))
    text = found[0][2].data[8:].rstrip(b"\0")  # of a std_msgs/String in CDR
    assert check_schema(json.loads(text)) == "edgetree.recording/1"


def test_the_command_names_the_other_program(run_cli: Cli) -> None:
    done = run_cli("schema", "perceptree.evaluation")
    expected = "expected `perceptree schema perceptree.evaluation`"
    assert (done.code, expected in done.err) == (2, True)
    newest = json.loads(run_cli("schema", "edgetree.bench").out)
    assert newest["title"] == "edgetree.bench/2"


def test_files_of_the_rig_are_valid(tmp_path: Path) -> None:
    camera = calib.PinholeCamera(640, 480, 500.0, 500.0, 319.5, 239.5)
    calib.save_camera(tmp_path / "camera.json", camera)
    calib.save_transform(tmp_path / "t.json", calib.RigidTransform(np.eye(3), np.zeros(3)))
    scale = DepthScale(1.01, 0.001, 0.002, 0.001, -0.5, 1.0, 6.0, (), ())
    calib.save_depth_scale(tmp_path / "scale.json", scale)
    for name in ("camera", "t", "scale"):
        assert check_schema(json.loads((tmp_path / f"{name}.json").read_text())).startswith(
            "calib."
        )


def test_files_of_shards_are_valid(run_cli: Cli, images: Path, model: Path, tmp_path: Path) -> None:
    parts = tmp_path / "parts"
    done = run_cli("run", images, "--model", model, "--shards", parts, "--json")
    assert done.code == 0, done.err
    files = [*sorted((parts / "shards").iterdir()), *sorted((parts / "parts").iterdir())]
    assert [check_schema(json.loads(path.read_text())) for path in files] == [
        *("edgetree.shard/1", "edgetree.job/1", "edgetree.part/1"),
    ]
    assert check_schema(json.loads(done.out)) == "edgetree.merge/1"


def test_files_of_signatures_and_recordings_and_states_are_valid(tmp_path: Path) -> None:
    write_trust_file(tmp_path / "t.json", TrustFile(True, (TrustedKey.of(bytes(32), "a", None),)))
    record_time(tmp_path / "used.json", datetime.now(UTC))
    camera = calib.PinholeCamera(640, 480, 500.0, 500.0, 319.5, 239.5)
    records = [
        json.loads((tmp_path / "t.json").read_text()),
        json.loads((tmp_path / "used.json").read_text()),
        json.loads(Statement("a", 1, 5, 64 * "0", "2026-11-23T08:00:00Z").to_json()),
        exact_record(5, None, None),
        exact_record(5, camera, np.array([0.0, -1.0, 0.0]), DepthNoise(noise_m=0.01)),
        ServiceState("running", "", 0.0, 3).record(),
        json.loads(state_message(ServiceState("gone"), 7)),
    ]
    assert [check_schema(record) for record in records][:4] == [
        *("edgetree.trust/1", "edgetree.used-versions/1", "edgetree.model-signature/1"),
        "edgetree.recording.frame/1",
    ]


def test_what_is_wrong_is_found() -> None:
    for record in (
        {"schema": "calib.camera/1", "width": 0, "height": 4, "fx": 1, "fy": 1, "cx": 0, "cy": 0},
        {"schema": "edgetree.merge/1", "frames": 1},
        {"schema": "edgetree.live.state/1", "state": "asleep", "reason": "", "since": None},
    ):
        with pytest.raises(jsonschema.ValidationError):
            check_schema(record)
