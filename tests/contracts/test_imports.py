"""Who may know whom: what importing loads, and which imports the sources hold."""

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("basetree", "calib", "edgetree", "fleet", "perceptree")
TRAINING_STACK = {"torch", "torchvision", "timm", "pycocotools", "safetensors", "numba"}
HEAVY = TRAINING_STACK | {"matplotlib", "onnx", "onnxruntime", "onnxscript", "perceptree", "PIL"}
HEAVY |= {"ray", "fsspec", "s3fs"}
HEAVY |= {"cryptography", "rosbags", "mcap", "mcap_protobuf", "av", "zstandard", "lz4"}
HEAVY |= {"pyrealsense2", "depthai", "pyorbbecsdk", "paho", "small_gicp", "lzfse", "zmq"}
HEAVY |= {"prometheus_client"}
READS_BAGS = {
    "edgetree.sinks.bag",
    "edgetree.sinks.ros_messages",
    "edgetree.sinks.ros_types",
    "edgetree.sources.bags.bounded",
    "edgetree.sources.bags.decoding",
    "edgetree.sources.bags.mcap_file",
    "edgetree.sources.bags.ros1_file",
    "edgetree.sources.bags.video_packets",
}
BAG_PACKAGES = {"rosbags", "mcap", "mcap_protobuf", "zstandard", "lz4", "av"}
# Modules that are imported when a file of their kind is opened, and need its package at once.
FILE_KINDS = {"edgetree.sources.bags.mcap_file", "edgetree.sources.bags.ros1_file"}
MAY_IMPORT = {
    "basetree": {"basetree", "numpy", "cv2", "typer", "msgspec", "ray", "fsspec", "pillow_heif"},
    "calib": {"calib", "basetree", "numpy", "cv2", "yaml", "laspy", "lazrs", "msgspec"},
    "fleet": {"fleet", "basetree"},
    "perceptree": TRAINING_STACK
    | {"perceptree", "calib", "basetree", "numpy", "cv2", "typer", "matplotlib", "msgspec"},
}
EDGETREE_BASE_DEPENDENCIES = {
    *("edgetree", "calib", "basetree", "numpy", "cv2", "typer", "msgspec"),
}
EDGETREE_TRAINING_SIDE = ("edgetree.export", "edgetree.demo", "edgetree.evaluate")


def loaded_by(statement: str, folder: Path = ROOT) -> set[str]:
    """Top-level modules that a fresh interpreter holds after `statement`."""
    code = f"{statement}\nimport json, sys\nprint(json.dumps(list(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True
    )
    return {name.partition(".")[0] for name in json.loads(done.stdout)}


@pytest.mark.parametrize(
    "statement", ["import edgetree", "import edgetree.cli", "import basetree.jobs"]
)
def test_edgetree_loads_nothing_heavy(statement: str) -> None:
    assert loaded_by(statement) & HEAVY == set()


def test_calib_loads_numpy_and_opencv_only() -> None:
    added = loaded_by("import calib") - loaded_by("pass") - set(sys.stdlib_module_names)
    # OpenCV and numpy may bring private helper modules of their own; no other project may come.
    assert {name for name in added if not name.startswith("_")} <= {
        "basetree",
        "calib",
        "numpy",
        "cv2",
    }


def test_the_loading_check_can_fail(tmp_path: Path) -> None:
    (tmp_path / "matplotlib.py").write_text("")
    (tmp_path / "careless.py").write_text("def lazily():\n    import onnx\nimport matplotlib\n")
    assert loaded_by("import careless", tmp_path) & HEAVY == {"matplotlib"}


class Import(NamedTuple):
    """One import statement's target, absolute; `always` when it runs as the module loads."""

    target: str
    always: bool


def imports_of(
    source: str, module: str, is_package: bool, for_types: bool = False
) -> Iterator[Import]:
    """All imports in a module's source, relative ones resolved.

    Those for type checkers alone are left out unless `for_types`.
    """
    tree = ast.parse(source)
    skipped: set[ast.AST] = set()
    nested: set[ast.AST] = set()
    for node in ast.walk(tree):
        is_typing = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        if is_typing and not for_types:
            skipped.update(child for part in node.body for child in ast.walk(part))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            nested.update(ast.walk(node))
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node not in nested)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                keep = len(parts) - node.level + (1 if is_package else 0)
                base = ".".join([*parts[:keep], *([base] if base else [])])
            for alias in node.names:
                yield Import(f"{base}.{alias.name}", node not in nested)


def all_imports(for_types: bool = False) -> Iterator[tuple[str, Import]]:
    """(importing module, import) for every file of the packages, as `imports_of`."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            is_package = path.name == "__init__.py"
            module = module.removesuffix(".__init__")
            source = path.read_text(encoding="utf-8")
            for found in imports_of(source, module, is_package, for_types):
                yield module, found


def is_foreign(found: Import) -> bool:
    return found.target.partition(".")[0] not in sys.stdlib_module_names


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_a_package_imports_only_what_it_may_know(package: str) -> None:
    strangers = {
        (module, found.target)
        for module, found in all_imports()
        if module.partition(".")[0] == package
        and is_foreign(found)
        and found.target.partition(".")[0] not in MAY_IMPORT[package]
    }
    assert strangers == set()


@pytest.mark.parametrize(
    "package", ["matplotlib", "ray", "fsspec", "laspy", "lazrs", "pillow_heif"]
)
def test_some_packages_are_loaded_when_they_are_needed(package: str) -> None:
    always = {
        module
        for module, found in all_imports()
        if found.always and found.target.partition(".")[0] == package
    }
    assert always == set()


def test_edgetree_reaches_the_training_side_from_few_places_only() -> None:
    strangers = set()
    for module, found in all_imports():
        top = found.target.partition(".")[0]
        if not module.startswith("edgetree") or not is_foreign(found):
            continue
        training_side = module.startswith(EDGETREE_TRAINING_SIDE)
        lazily = HEAVY if training_side else {"onnxruntime"}
        lazily |= {"cryptography"} if module == "edgetree.signing.keys" else set()
        lazily |= {"torch"} if module == "edgetree.bench.peak" else set()
        lazily |= {"paho"} if module == "edgetree.sinks.mqtt" else set()
        lazily |= {"zmq"} if module == "edgetree.serve.router" else set()
        lazily |= {"prometheus_client"} if module == "edgetree.live.health" else set()
        lazily |= {"supervision"} if module == "edgetree.detections" else set()
        lazily |= BAG_PACKAGES if module in READS_BAGS else set()
        lazily |= {"small_gicp"} if module == "edgetree.live.tracking.odometry" else set()
        lazily |= {"lzfse"} if module == "edgetree.sources.phones.lzfse" else set()
        if top not in EDGETREE_BASE_DEPENDENCIES | lazily or (
            found.always and top in HEAVY and module not in FILE_KINDS
        ):
            strangers.add((module, found.target))
    assert strangers == set()


def circle_in(arrows: dict[str, set[str]]) -> list[str]:
    """Nodes that lead back to the first of them; none if there is no circle."""
    done: set[str] = set()

    def walk(node: str, path: list[str]) -> list[str]:
        if node in path:
            return [*path[path.index(node) :], node]
        if node in done:
            return []
        for target in sorted(arrows.get(node, ())):
            if found := walk(target, [*path, node]):
                return found
        done.add(node)
        return []

    return next((found for node in sorted(arrows) if (found := walk(node, []))), [])


@pytest.mark.parametrize("package", PACKAGES)
def test_no_two_folders_of_a_package_need_each_other(package: str) -> None:
    arrows: dict[str, set[str]] = {}
    for module, found in all_imports():
        start, end = module.split("."), found.target.split(".")
        inside = start[0] == end[0] == package and len(start) > 1 and len(end) > 1
        if inside and start[1] != end[1] and is_module(package, end[1]):
            arrows.setdefault(start[1], set()).add(end[1])
    assert circle_in(arrows) == []


def module_of(target: str) -> str:
    """The module or package of this project that an imported name is, or is of."""
    while target and not (ROOT / target.replace(".", "/")).with_suffix(".py").is_file():
        if (ROOT / target.replace(".", "/") / "__init__.py").is_file():
            break
        target = target.rpartition(".")[0]
    return target


@pytest.mark.parametrize("package", PACKAGES)
def test_no_two_modules_need_each_other(package: str) -> None:
    arrows: dict[str, set[str]] = {}
    for module, found in all_imports(for_types=True):
        end = module_of(found.target)
        inside = module.partition(".")[0] == end.partition(".")[0] == package
        if inside and module != end:
            arrows.setdefault(module, set()).add(end)
    assert circle_in(arrows) == []


def is_module(package: str, name: str) -> bool:
    """Whether a name of a package is a folder or file, and no object of its `__init__`."""
    return (ROOT / package / name).is_dir() or (ROOT / package / f"{name}.py").is_file()


def test_the_search_for_circles_can_fail() -> None:
    assert circle_in({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert circle_in({"a": {"b", "c"}, "b": {"c"}}) == []


def is_command_line(target: str) -> bool:
    """Whether a dotted name is, or lies in, a package's command line."""
    parts = target.split(".")
    return parts[0] in PACKAGES and len(parts) > 1 and parts[1] in ("cli", "commands")


def test_only_the_command_line_imports_the_command_line() -> None:
    strangers = {
        (module, found.target)
        for module, found in all_imports()
        if is_command_line(found.target)
        and not is_command_line(module)
        and module.rpartition(".")[2] != "__main__"
    }
    assert strangers == set()


def test_the_source_check_can_fail() -> None:
    source = (
        "from typing import TYPE_CHECKING\n"
        "from . import cli\n"
        "from ..models import spec\n"
        "if TYPE_CHECKING:\n    import onnx\n"
        "def lazily():\n    import torch.nn\n"
    )
    found = set(imports_of(source, "perceptree.data.reader", is_package=False))
    assert found == {
        Import("typing.TYPE_CHECKING", True),
        Import("perceptree.data.cli", True),
        Import("perceptree.models.spec", True),
        Import("torch.nn", False),
    }
    for_types = set(imports_of(source, "perceptree.data.reader", False, for_types=True))
    assert for_types - found == {Import("onnx", True)}
    assert module_of("calib.depth.files.read_depth") == "calib.depth.files"
    assert module_of("calib.depth.read_depth") == "calib.depth"
    assert module_of("numpy.float32") == ""
    assert is_command_line("perceptree.cli.main")
    assert is_command_line("edgetree.commands")
    assert not is_command_line("edgetree.measure.commands")
