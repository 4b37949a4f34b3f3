"""The programs of examples/hosts: what they do around the network, and whole kits where tools are.

Tests of whole programs install packages from a registry: they are slow, and skipped where a tool is
missing.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from both_model import write_both_model
from once import Once

from edgetree import TreeDetector, default_model, sample_frames
from edgetree.conformance import make_kit, read_kit
from edgetree.conformance.kit import read_expected, read_frame
from edgetree.conformance.reference import Reference
from edgetree.runtime.session import OrtSession
from edgetree.sample_files import write_samples

HOSTS = Path(__file__).parents[2] / "examples" / "hosts"
PARTS = Path(__file__).parent / "host_parts"
BOTH = HOSTS.parents[1] / "models" / "edge-s.onnx"
MODELS = ["edge-n-rgb", "edge-s-rgb", "edge-n-depth", "edge-s-depth", str(BOTH)]
MINUTES_10 = 600

Outputs = dict[str, np.ndarray]


def tool(*names: str) -> str:
    """The first of these programs that is installed; skips the test if none is."""
    for name in names:
        found = shutil.which(name)
        if found is not None:
            return found
    pytest.skip(f"{' or '.join(names)} is not installed")


def node() -> str:
    program = tool("node")
    version = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    if int(version.stdout.lstrip("v").split(".")[0]) < 20:
        pytest.skip(f"node is {version.stdout.strip()}: the hosts need 20 or newer")
    return program


@pytest.fixture(scope="module", params=["rgb", "depth", "both"])
def kit(request: pytest.FixtureRequest, kit_of: Callable[[str], Path], once: Once) -> Path:
    if request.param == "both":
        return once.folder("kit-both", make_kit_of_both) / "kit"
    return kit_of(f"edge-n-{request.param}")


def make_kit_of_both(folder: Path) -> None:
    write_both_model(folder / "both.onnx")
    make_kit(folder / "both.onnx", folder / "kit")


@pytest.fixture(scope="module")
def passes(kit: Path) -> dict[str, tuple[dict[str, np.ndarray], Outputs]]:
    """The network's inputs and outputs for each frame of the kit."""
    seen: list[tuple[dict[str, np.ndarray], Outputs]] = []

    class Watched(OrtSession):
        def run(self, inputs: Any) -> dict[str, Any]:
            outputs = super().run(inputs)
            images = {name: each[0] for name, each in inputs.items() if each.dtype == np.uint8}
            seen.append((images, outputs))
            return outputs

    content = read_kit(kit)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("edgetree.runtime.detector.OrtSession", Watched)
        reference = Reference(kit / content.model, score_threshold=content.score_threshold)
    for frame in content.frames:
        reference.detect(read_frame(kit, frame), frame.pinhole)
    return {frame.name: one for frame, one in zip(content.frames, seen, strict=True)}


def run_js(kit: Path, outputs: Path, out: Path) -> None:
    command = [node(), str(PARTS / "parts.mjs"), str(kit), str(outputs), str(out)]
    subprocess.run(command, check=True, timeout=120)


def run_cpp(kit: Path, outputs: Path, out: Path) -> None:
    parts = ("json", "manifest", "prepare", "reach", "resize", "trees")
    sources = [HOSTS / "cpp" / f"{name}.cpp" for name in parts]
    program = out / "parts"
    command = [tool("c++", "g++", "clang++"), "-std=c++20", "-O1", "-Wall", "-Wextra", "-Werror"]
    command += [f"-I{HOSTS / 'cpp'}", str(PARTS / "parts.cpp"), *map(str, sources)]
    subprocess.run([*command, "-o", str(program)], check=True, timeout=120)
    subprocess.run([str(program), str(kit), str(outputs), str(out)], check=True, timeout=120)


@pytest.mark.parametrize("run", [run_js, run_cpp], ids=["js", "cpp"])
def test_what_a_host_does_around_the_network(
    run: Callable[[Path, Path, Path], None],
    kit: Path,
    passes: dict[str, tuple[dict[str, np.ndarray], Outputs]],
    tmp_path: Path,
) -> None:
    given, out = tmp_path / "outputs", tmp_path / "out"
    given.mkdir()
    out.mkdir()
    for name, (_, outputs) in passes.items():
        tensors = {
            key: {"shape": value.shape, "values": value.ravel().tolist()}
            for key, value in outputs.items()
        }
        (given / f"{name}.json").write_text(json.dumps(tensors), "utf-8")
    run(kit, given, out)

    for name, (inputs, _) in passes.items():
        for kind, pixels in inputs.items():
            theirs = np.fromfile(out / f"{name}.{kind}.raw", np.uint8).reshape(pixels.shape)
            off = np.abs(theirs.astype(int) - pixels)
            assert off.max() <= 1, name  # means half way between two greys, summed otherwise
            assert (off > 0).mean() < 0.001, name
    found = json.loads((out / "trees.json").read_text("utf-8"))
    for frame in read_expected(kit).frames:
        assert len(found[frame.name]) == len(frame.trees), frame.name
        for theirs, ours in zip(found[frame.name], frame.trees, strict=True):
            assert theirs["score"] == pytest.approx(ours.score, abs=2e-4)
            np.testing.assert_allclose(theirs["box_px"], ours.box_px, atol=2e-2)
            np.testing.assert_allclose(theirs["keypoints_px"], ours.keypoints_px, atol=2e-2)


NO_IMAGE = "a frame has no image: expected colour or depth"


def test_a_frame_without_an_image_is_refused_in_javascript() -> None:
    inputs = [{"name": name, "width": 64, "height": 32} for name in ("colour", "depth")]
    manifest = json.dumps({"modality": "both", "input": inputs[0], "inputs": inputs})
    script = f"""
import {{ prepare }} from "{(HOSTS / "js" / "prepare.js").as_uri()}";
try {{
  prepare({{ width: 2, height: 2, data: new Uint16Array(4) }}, {manifest});
}} catch (error) {{
  console.log(error.message);
}}
"""
    assert run_checked(node(), "--input-type=module", "--eval", script).strip() == NO_IMAGE


def test_a_frame_without_an_image_is_refused_in_cpp(tmp_path: Path) -> None:
    text = """
#include <iostream>
#include "prepare.hpp"
int main() {
    Manifest manifest{};
    manifest.width = 64, manifest.height = 32;
    manifest.inputs = {{"colour", 3, 0, 0}, {"depth", 1, 0, 0}};
    try {
        Preparation(manifest).inputs_of({2, 2, {}, {}, {}});
    } catch (const std::exception& error) {
        std::cout << error.what();
    }
}
"""
    (tmp_path / "main.cpp").write_text(text)
    sources = [str(HOSTS / "cpp" / name) for name in ("prepare.cpp", "resize.cpp")]
    program = str(tmp_path / "main")
    command = [tool("c++", "g++", "clang++"), "-std=c++20", f"-I{HOSTS / 'cpp'}", "-o", program]
    run_checked(*command, str(tmp_path / "main.cpp"), *sources)
    assert run_checked(program) == NO_IMAGE


def run_checked(*command: str, cwd: Path | None = None) -> str:
    scripts = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=MINUTES_10
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS, ids=lambda model: Path(model).stem)
def test_the_node_host_passes_its_kit(model: str) -> None:
    node()
    tool("npm")
    out = run_checked("bash", str(HOSTS / "node" / "check.sh"), model)
    assert out.splitlines()[-1] == "passed: it finds the kit's trees"


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS, ids=lambda model: Path(model).stem)
def test_the_cpp_host_passes_its_kit(model: str) -> None:
    tool("cmake")
    tool("c++", "g++", "clang++")
    out = run_checked("bash", str(HOSTS / "cpp" / "check.sh"), model)
    assert out.splitlines()[-1] == "passed: it finds the kit's trees"


@pytest.mark.slow
def test_the_browser_host_passes_the_kit_of_the_depth_model() -> None:
    """That of the colour model passes in float32 only: see the guide."""
    node()
    tool("npm")
    tool("chromium", "chromium-browser", "google-chrome")
    out = run_checked("bash", str(HOSTS / "browser" / "check.sh"), "depth")
    assert out.splitlines()[-1] == "passed: it finds the kit's trees"


@pytest.mark.slow
def test_the_page_finds_trees_in_a_picture_and_a_camera(tmp_path: Path) -> None:
    program = node()
    tool("chromium", "chromium-browser", "google-chrome")
    run_checked(tool("npm"), "ci", cwd=HOSTS / "browser")
    sample, model = sample_frames()[0], default_model("rgb")
    script = str(HOSTS / "browser" / "test-page.js")
    out = run_checked(program, script, str(model), str(sample.image_path), str(tmp_path))
    counts = json.loads(out.splitlines()[-1])
    ours = len(TreeDetector.load(model).detect(sample.image()))
    assert abs(counts["picture"] - ours) <= 1  # the browser decodes JPEG otherwise
    assert abs(counts["camera"] - ours) <= 2  # and its camera compresses the picture again
    assert (tmp_path / "picture.png").stat().st_size > 100_000


@pytest.fixture(scope="module")
def drive_frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raw frames of the drive of `edgetree samples`, its files beside them."""
    folder = tmp_path_factory.mktemp("service")
    write_samples(folder / "samples")
    script = str(HOSTS / "service" / "raw_frames.py")
    run_checked(sys.executable, script, str(folder / "samples" / "drive"), str(folder / "frames"))
    some = (folder / "frames" / "frames.txt").read_text("utf-8").splitlines(keepends=True)[:8]
    (folder / "frames" / "frames.txt").write_text("".join(some), "utf-8")
    return folder


@contextmanager
def service(folder: Path, before: str = "") -> Iterator[str]:
    """Run `edgetree live clients --serve` after some Python code; yields its address."""
    address = f"ipc://{folder}/service"
    program = f"{before}\nfrom edgetree.cli import main\nmain()"
    command = [sys.executable, "-c", program, "live", "clients", "--serve", address]
    with (folder / "service.log").open("w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            yield address
        finally:
            process.terminate()
            try:
                process.wait(60)
            except subprocess.TimeoutExpired:  # that it ends is asserted in tests of the command
                process.kill()
                process.wait()


OF_ANOTHER_USER = """
from basetree.errors import InputError
from edgetree.serve.shared_memory import OpenMemories

def read(memories, image):
    raise InputError("shared memory x cannot be read (Permission denied)")

OpenMemories.read = read
"""


def check_metres(folder: Path, answers: str) -> None:
    """Compare answers of the service with what `edgetree run` says of the same drive."""
    drive, lines = folder / "samples" / "drive", folder / "run.jsonl"
    command = ("run", str(drive), "--model", "depth", "--jsonl", str(lines))
    run_checked(sys.executable, "-m", "edgetree", *command)
    expected = [json.loads(line) for line in lines.read_text("utf-8").splitlines()]
    got = [json.loads(line)["result"] for line in answers.splitlines()]
    assert len(got) == 8
    assert sum(len(frame["trees"]) for frame in got) > 8
    for ours, theirs in zip(expected[:8], got, strict=True):
        assert [tree["metres"] for tree in theirs["trees"]] == [
            tree["metres"] for tree in ours["trees"]
        ]


@pytest.mark.parametrize("before", ["", OF_ANOTHER_USER], ids=["memory", "parts"])
def test_a_cpp_program_gets_metres_through_the_service(drive_frames: Path, before: str) -> None:
    pytest.importorskip("zmq")
    script = str(HOSTS / "service" / "zmq_library.py")
    library = run_checked(sys.executable, script).strip()
    build = str(drive_frames / "build")
    source = str(HOSTS / "service" / "cpp")
    cmake = tool("cmake")
    tool("c++", "g++", "clang++")
    run_checked(cmake, "-S", source, "-B", build, f"-DZMQ_LIBRARY={library}")
    run_checked(cmake, "--build", build)
    frames = str(drive_frames / "frames")
    with service(drive_frames, before) as address:
        answers = run_checked(str(Path(build) / "measure_frames"), address, frames)
    check_metres(drive_frames, answers)


@pytest.mark.slow
def test_a_node_program_gets_metres_through_the_service(drive_frames: Path) -> None:
    pytest.importorskip("zmq")
    program, package = node(), HOSTS / "service" / "node"
    run_checked(tool("npm"), "ci", "--no-audit", "--no-fund", cwd=package)
    frames = str(drive_frames / "frames")
    with service(drive_frames) as address:
        answers = run_checked(program, "measure-frames.mjs", address, frames, cwd=package)
    check_metres(drive_frames, answers)


def test_the_cpp_program_is_short() -> None:
    lines = (HOSTS / "service" / "cpp" / "measure_frames.cpp").read_text("utf-8").splitlines()
    assert len(lines) < 100
