"""Every function that opens a file, or parses what comes from elsewhere, is reached by the fuzzer.

A function counts as reached if a valid file of some format in ``formats`` runs it.
"""

import ast
import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

pytest.importorskip("torch")
pytest.importorskip("cryptography")
pytest.importorskip("rosbags")
pytest.importorskip("lzfse")
sys.path.insert(0, str(Path(__file__).parent))
from formats import FORMATS

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("basetree", "calib", "edgetree", "perceptree")
# The last parts of calls that open or parse.
OPENS = {
    *("open_regular", "read_regular", "read_bytes", "read_text", "read_json", "parse_json"),
    *("fromfile", "memmap", "imdecode", "VideoCapture", "FileStorage", "recv", "recv_into"),
    *("ZipFile", "is_zipfile", "load_all", "safe_load", "genops", "Unpickler", "recvfrom"),
}
# Calls whose last part alone says too little.
OPENS_OF = {
    *("json.loads", "json.load", "np.load", "torch.load", "sqlite3.connect", "mmap.mmap"),
    *("msgspec.convert", "msgspec.json.decode", "av.open", "os.open", "pickle.load", "csv.reader"),
}

# Functions that need no format, and why.
OWN = "it reads what the installation or this process wrote"
SUMS = "it sums up or copies bytes and looks at none of them"
SYSTEM = "it reads files of the operating system"
WRITES = "it opens what it writes"
LICENCES = "it looks for the names of licences in a text"
MEMORY = "it decodes what it has encoded"
EXCEPTIONS = {
    "basetree/files/growing.py:_new_file": WRITES,
    "basetree/files/growing.py:_stream": WRITES,
    "basetree/files/growing.py:_sync_file": WRITES,
    "basetree/files/growing.py:_unless_written": WRITES,
    "basetree/files/locking.py:locked": WRITES,
    "basetree/files/writing.py:_new_folder": WRITES,
    "basetree/files/writing.py:_remove_if_left": WRITES,
    "basetree/files/writing.py:_replace_folder": WRITES,
    "basetree/jobs/stores.py:copy_folder": SUMS,
    "basetree/page/parts.py:start": OWN,
    "basetree/program/process.py:_discard_rest": WRITES,
    "edgetree/bench/profile.py:_profile": OWN,
    "edgetree/bench/rounds.py:_run": OWN,
    "edgetree/bench/sensors.py:_text": SYSTEM,
    "edgetree/bench/speed.py:peak_memory_mib": SYSTEM,
    "edgetree/bench/worker.py:_detail": OWN,
    "edgetree/bench/worker.py:main": OWN,
    "edgetree/commands/bench_accuracy.py:_labels_sha256": SUMS,
    "edgetree/commands/sharding.py:identity": SUMS,
    "edgetree/doctor/machine.py:_read": SYSTEM,
    "edgetree/live/page/document.py:_asset": OWN,
    "edgetree/live/recording/file.py:run_record": SUMS,
    "edgetree/report/frame_report.py:_asset": OWN,
    "edgetree/sample_files.py:_copy": OWN,
    "edgetree/samples.py:_read_sample": OWN,
    "edgetree/serve/client.py:_received": "it reads what the service on this machine wrote",
    "edgetree/serve/router.py:wait": "it empties a bell that this process rings",
    "edgetree/serve/shared_memory.py:_made": WRITES,
    "edgetree/shards/work.py:_model_here": SUMS,
    "edgetree/shards/work.py:model_files": SUMS,
    "edgetree/sinks/geopackage.py:geopackage": WRITES,
    "edgetree/sources/cameras/opencv.py:_open": "it opens cameras",
    "edgetree/sources/bags/names.py:_starts_as_one": "it compares the first bytes",
    "edgetree/conformance/kit.py:make_kit": SUMS,
    "edgetree/signing/sign.py:sign_model": SUMS,
    "edgetree/signing/verify.py:_read": SUMS,
    "perceptree/commands/eval.py:_in_shards": SUMS,
    "perceptree/data/augment/colour.py:recolour": MEMORY,
    "perceptree/data/exchange/places.py:copy": SUMS,
    "perceptree/evaluation/shards.py:labels_sha256": SUMS,
    "perceptree/simulator/dataset/frozen.py:_digests": SUMS,
    "perceptree/simulator/dataset/shards.py:_copy_scene": SUMS,
    "perceptree/simulator/dataset/frozen.py:read_frozen": OWN,
    "perceptree/simulator/dataset/scene_job.py:records": OWN,
    "perceptree/simulator/photographs/folder.py:_credits": LICENCES,
    "perceptree/simulator/photographs/folder.py:_sha256": SUMS,
    "perceptree/simulator/kernel_cache.py:sources_sha256": OWN,
    "perceptree/simulator/rows.py:read_rows": OWN,
    "perceptree/simulator/sensors/imaging.py:_jpeg": MEMORY,
    "perceptree/tables/results.py:make_result": OWN,
    "perceptree/tables/results.py:open": OWN,
    "perceptree/training/growing.py:_start_simulating": OWN,
}


def _last_parts(call: ast.Call) -> tuple[str, str]:
    """The called name, and the name with what stands before it."""
    function = call.func
    if isinstance(function, ast.Attribute):
        return function.attr, ast.unparse(function)
    return (function.id, function.id) if isinstance(function, ast.Name) else ("", "")


def _opens(call: ast.Call) -> bool:
    last, whole = _last_parts(call)
    if last == "open":
        modes = [node.value for node in ast.walk(call) if isinstance(node, ast.Constant)]
        is_writing = any(isinstance(mode, str) and mode[:1] in tuple("wxa") for mode in modes)
        is_path = whole == "open" or (whole.endswith(".open") and "rb" in modes)
        return whole in OPENS_OF or (is_path and not is_writing)
    return last in OPENS or whole in OPENS_OF


def _functions(node: ast.AST, name: str) -> Iterator[str]:
    """The names of functions with calls that open or parse; of calls outside the module's own."""
    for child in ast.iter_child_nodes(node):
        is_function = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)
        if isinstance(child, ast.Call) and _opens(child):
            yield name
        yield from _functions(child, child.name if is_function else name)


def readers(source: str) -> set[str]:
    """The functions of a module that open or parse."""
    return set(_functions(ast.parse(source), "<module>"))


def _all_readers() -> set[str]:
    return {
        f"{path.relative_to(ROOT)}:{name}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for name in readers(path.read_text("utf-8"))
    }


def _reached(folder: Path) -> set[str]:
    """The functions that the valid files of all formats run."""
    found: set[tuple[str, str]] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            found.add((frame.f_code.co_filename, frame.f_code.co_name))

    for name, form in FORMATS.items():
        for seed in form.seeds:
            path = folder / f"file-{name}"
            path.write_bytes(seed)
            sys.setprofile(note)
            try:
                with contextlib.suppress(Exception):  # which the fuzzer tells
                    form.read(path)
            finally:
                sys.setprofile(None)
    return {
        f"{Path(file).relative_to(ROOT)}:{name}"
        for file, name in found
        if file.startswith(str(ROOT))
    }


def test_every_reader_is_fuzzed(tmp_path: Path) -> None:
    known, reached = _all_readers(), _reached(tmp_path)
    excepted = set(EXCEPTIONS)
    without = sorted(known - reached - excepted)
    assert not without, f"without a format in tests/fuzz/formats: {without}"
    gone = sorted(excepted - known)
    assert not gone, f"no reader any more: {gone}"


@pytest.mark.parametrize(
    "call",
    [
        "path.open('rb')",
        "open(path)",
        "path.read_bytes()",
        "np.load(path)",
        "json.loads(text)",
        "sqlite3.connect(name)",
        "connection.recv(10)",
        "cv2.imdecode(data, 1)",
        "zipfile.ZipFile(path)",
    ],
)
def test_the_list_finds_readers(call: str) -> None:
    assert readers(f"def outer():\n def read(path):\n  return {call}\n") == {"read"}


@pytest.mark.parametrize(
    "call", ["path.open('wb')", "job.open()", "np.save(path)", "json.dumps(1)"]
)
def test_the_list_leaves_out_others(call: str) -> None:
    assert readers(f"def read(path):\n  return {call}\n") == set()
