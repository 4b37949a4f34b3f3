"""Every place that writes JSON has schemas for what it writes, or a reason why not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import edgetree.schemas
import perceptree.schemas

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("basetree", "calib", "edgetree", "perceptree")
WRITES = re.compile(
    r"json\.dumps?\(|msgspec\.json\.encode\(|\b(?:print_json|print_found|json_text|write_json_line)\("
)
NAMES = {*edgetree.schemas.schema_names(), *perceptree.schemas.schema_names()}

# Schemas of what each file writes.
SCHEMAS = {
    "basetree/jobs/job.py": {"edgetree.job/1"},
    "basetree/jobs/manifests.py": {"edgetree.shard/1"},
    "calib/depth_scale.py": {"calib.depth_scale/1"},
    "calib/files/cameras.py": {"calib.camera/1"},
    "calib/files/stereo.py": {"calib.stereo/1"},
    "calib/files/transforms.py": {"calib.transform/1"},
    "edgetree/check/files.py": {"edgetree.check_settings/1"},
    "edgetree/commands/bench.py": {"edgetree.bench/2"},
    "edgetree/commands/calibrate.py": {"edgetree.calibrate/1"},
    "edgetree/commands/check.py": {"edgetree.check/1"},
    "edgetree/commands/check_rig.py": {"edgetree.check-rig/1"},
    "edgetree/commands/compare.py": {"edgetree.bench-comparison/1"},
    "edgetree/commands/conformance.py": {
        "edgetree.conformance-make/1",
        "edgetree.conformance-check/1",
    },
    "edgetree/commands/demo.py": {"edgetree.demo/1"},
    "edgetree/commands/doctor.py": {"edgetree.doctor/1"},
    "edgetree/commands/eval.py": {"perceptree.evaluation/1"},
    "edgetree/commands/export.py": {"edgetree.export/1"},
    "edgetree/commands/measure.py": {"edgetree.measure/1"},
    "edgetree/commands/models.py": {"edgetree.models/1", "edgetree.card/1"},
    "edgetree/commands/run.py": {"edgetree.run/1"},
    "edgetree/commands/sharding.py": {"edgetree.merge/1", "edgetree.written-shard/1"},
    "edgetree/commands/verify.py": {"edgetree.export/1"},
    "edgetree/conformance/kit.py": {"edgetree.conformance-kit/1"},
    "edgetree/conformance/results.py": {"edgetree.conformance-results/1"},
    "edgetree/live/page/handler.py": {"edgetree.live.page/1"},
    "edgetree/live/page/service.py": {"edgetree.live.page/1", "edgetree.live.state/1"},
    "edgetree/live/recording/messages.py": {
        "edgetree.recording/1",
        "edgetree.recording.frame/1",
    },
    "edgetree/model_file/manifest.py": {"edgetree.manifest/1"},
    "edgetree/results/json_records.py": {"edgetree.live.stems/1", "edgetree.frame/1"},
    "edgetree/results/service_state.py": {"edgetree.live.state/1"},
    "edgetree/sample_files.py": {"calib.camera/1"},
    "edgetree/serve/client.py": {
        "edgetree.serve.frame/1",
        "edgetree.serve.watch/1",
        "edgetree.serve.ask/1",
        "edgetree.serve.bye/1",
    },
    "edgetree/serve/answers.py": {
        "edgetree.serve.result/1",
        "edgetree.serve.error/1",
        "edgetree.serve.status/1",
        "edgetree.serve.unused/1",
    },
    "edgetree/shards/merging.py": {"edgetree.frame/1"},
    "edgetree/shards/work.py": {"edgetree.part/1"},
    "edgetree/signing/envelope.py": {"edgetree.signature-file/1"},
    "edgetree/signing/statement.py": {"edgetree.model-signature/1"},
    "edgetree/signing/trust.py": {"edgetree.trust/1"},
    "edgetree/signing/used_versions.py": {"edgetree.used-versions/1"},
    "edgetree/sinks/maps.py": {"edgetree.live.map/1"},
    "edgetree/sinks/pictures.py": {"calib.found-labels/1"},
    "edgetree/sinks/ros_messages.py": {"edgetree.live/1"},
    "edgetree/sinks/text_files.py": {"edgetree.live/1", "edgetree.live.state/1"},
    "perceptree/commands/data.py": {"perceptree.data-check/1", "perceptree.data-compare/1"},
    "perceptree/commands/data_exchange.py": {"perceptree.data-written/1"},
    "perceptree/commands/eval.py": {"perceptree.evaluation/1"},
    "perceptree/commands/import_.py": {"perceptree.import/1"},
    "perceptree/commands/predict.py": {"perceptree.predict/1", "calib.found-labels/1"},
    "perceptree/commands/shards.py": {"edgetree.written-shard/1"},
    "perceptree/commands/synth_result.py": {"perceptree.synth/1"},
    "perceptree/commands/tables.py": {"perceptree.table/1"},
    "perceptree/commands/train.py": {"perceptree.train/1"},
    "perceptree/data/exchange/write_coco.py": {"perceptree.labels/2"},
    "perceptree/data/stated.py": {"perceptree.data-settings/1"},
    "perceptree/evaluation/report.py": {"perceptree.evaluation/1"},
    "perceptree/evaluation/shards.py": {"perceptree.predictions/1"},
    "perceptree/models/checkpoint.py": {"perceptree.checkpoint/1"},
    "perceptree/simulator/dataset/frozen.py": {"perceptree.frozen-set/1"},
    "perceptree/simulator/dataset/generate.py": {"perceptree.labels/2"},
    "perceptree/simulator/dataset/pages.py": {"perceptree.statistics/1"},
    "perceptree/simulator/dataset/plan.py": {"perceptree.synth-settings/2"},
    "perceptree/simulator/dataset/scene_job.py": {"perceptree.scene-frames/1"},
    "perceptree/tables/build.py": {"perceptree.tables/1"},
    "perceptree/tables/results.py": {"perceptree.table-run/1"},
    "perceptree/training/run_log.py": {"perceptree.training-log/1"},
}
WITHOUT = {
    "basetree/files/json.py": "what others give it, and texts of messages",
    "basetree/program/console.py": "what others give it",
    "basetree/program/schemas.py": "schemas themselves",
    "basetree/program/setup_file.py": "texts in a TOML file",
    "edgetree/bench/rounds.py": "to a process of its own",
    "edgetree/bench/worker.py": "from a process of its own",
    "edgetree/report/units.py": "numbers for the page's own script",
    "edgetree/serve/messages.py": "schemas themselves",
    "edgetree/shards/inputs.py": "hashed only",
    "perceptree/data/cache.py": "a cache of this version, which no other program reads",
    "perceptree/data/content.py": "made for a reader of this package",
    "perceptree/data/exchange/write_labelme.py": "the form of labelme",
    "perceptree/simulator/geometry/gltf.py": "the form of glTF",
    "perceptree/training/state.py": "what an interrupted training goes on from, of this version",
}


def writers(root: Path) -> set[str]:
    found = set()
    for package in PACKAGES:
        for path in (root / package).rglob("*.py"):
            lines = path.read_text(encoding="utf-8").splitlines()
            if any(WRITES.search(line) for line in lines if not line.startswith("def ")):
                found.add(path.relative_to(root).as_posix())
    return found


def test_every_writer_of_json_has_schemas_or_a_reason() -> None:
    assert writers(ROOT) == SCHEMAS.keys() | WITHOUT.keys()
    assert not SCHEMAS.keys() & WITHOUT.keys()


def test_the_schemas_are_those_of_the_writers() -> None:
    assert set().union(*SCHEMAS.values()) == NAMES


@pytest.mark.parametrize("call", ["json.dump(x, file)", "print_json(record)", "json_text(S, x)"])
def test_the_check_finds_writers(call: str, tmp_path: Path) -> None:
    for package in PACKAGES:
        (tmp_path / package).mkdir()
    (tmp_path / "calib" / "new.py").write_text(f"def f():\n    {call}\n")
    assert writers(tmp_path) == {"calib/new.py"}
