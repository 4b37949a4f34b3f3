"""Findings from imitated files of /proc and /sys, and from this machine."""

from pathlib import Path

import pytest

from edgetree.doctor import providers
from edgetree.doctor.examine import examine_models
from edgetree.doctor.libraries import import_error, minimum_versions
from edgetree.doctor.machine import core_quota, examine_machine, instruction_sets, memory_mib
from edgetree.doctor.providers import examine_providers

MEMINFO = "MemTotal:        8388608 kB\nMemFree:         1048576 kB\nMemAvailable:    4194304 kB\n"


def write(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def test_instructions_of_x86_and_arm() -> None:
    x86 = "processor\t: 0\nflags\t\t: fpu avx2 avx512f avx512_vnni avx_vnni amx_int8 avx512bw\n"
    names = ("avx2", "avx512", "avx512_vnni", "avx_vnni", "amx_int8")
    assert instruction_sets(x86) == names
    assert instruction_sets("Features\t: fp asimd asimddp i8mm\n") == ("dotprod", "i8mm")
    assert instruction_sets("flags\t: fpu sse2\n") == ()
    assert instruction_sets("") is None


def test_missing_files_give_unknown_values(tmp_path: Path) -> None:
    machine = examine_machine(tmp_path)
    assert machine.instructions is None
    assert machine.core_quota is None
    assert (machine.memory_mib, machine.free_memory_mib) == (None, None)
    assert 1 <= machine.usable_cores <= machine.cores


def test_a_board_whose_processor_has_no_name_is_named(tmp_path: Path) -> None:
    (tmp_path / "proc" / "device-tree").mkdir(parents=True)
    (tmp_path / "proc" / "cpuinfo").write_text("processor\t: 0\nFeatures\t: fp asimd\n")
    (tmp_path / "proc" / "device-tree" / "model").write_bytes(b"Raspberry Pi 4 Model B\0")
    assert examine_machine(tmp_path).processor == "Raspberry Pi 4 Model B"


def test_a_model_that_cannot_be_read_is_broken_and_hides_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "forest.onnx").symlink_to("gone.onnx")
    monkeypatch.setenv("EDGETREE_MODELS", str(tmp_path))
    models, faults = examine_models()
    assert {"edge-n-depth", "edge-n-rgb"} <= {model.name for model in models}
    assert faults == (
        f"model {tmp_path / 'forest.onnx'} cannot be read (No such file or directory): repair or"
        " remove it",
    )
    monkeypatch.setenv("EDGETREE_MODELS", str(tmp_path / "none"))
    assert examine_models() == (
        (),
        (f"EDGETREE_MODELS names {tmp_path / 'none'}: expected an existing folder",),
    )


QUOTAS: dict[str, tuple[dict[str, str], float | None]] = {
    "none": ({}, None),
    "version 2, the container's own": ({"sys/fs/cgroup/cpu.max": "150000 100000\n"}, 1.5),
    "version 2, not limited": ({"sys/fs/cgroup/cpu.max": "max 100000\n"}, None),
    "version 2, a group above": (
        {
            "proc/self/cgroup": "0::/a/b\n",
            "sys/fs/cgroup/a/cpu.max": "50000 100000\n",
            "sys/fs/cgroup/a/b/cpu.max": "max 100000\n",
        },
        0.5,
    ),
    "version 1": (
        {
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "200000\n",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n",
        },
        2.0,
    ),
    "version 1, not limited": (
        {
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1\n",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n",
        },
        None,
    ),
}


@pytest.mark.parametrize("case", QUOTAS)
def test_the_cpu_quota_of_a_container(tmp_path: Path, case: str) -> None:
    files, expected = QUOTAS[case]
    assert core_quota(write(tmp_path, files)) == expected


def test_a_containers_lower_memory_limit_is_used(tmp_path: Path) -> None:
    assert memory_mib(write(tmp_path, {"proc/meminfo": MEMINFO})) == (8192.0, 4096.0)
    limits = {"sys/fs/cgroup/memory.max": "1073741824\n", "sys/fs/cgroup/memory.current": "0\n"}
    assert memory_mib(write(tmp_path, limits)) == (1024.0, 1024.0)
    unlimited = {
        "sys/fs/cgroup/memory.max": "max\n",
        "sys/fs/cgroup/memory/memory.limit_in_bytes": "9223372036854771712\n",
        "sys/fs/cgroup/memory/memory.usage_in_bytes": "4096\n",
    }
    assert memory_mib(write(tmp_path, unlimited)) == (8192.0, 4096.0)


@pytest.mark.parametrize(
    ("limit", "usage", "stat"),
    [
        ("memory.max", "memory.current", "file 900000000\ninactive_file 805306368\n"),
        (
            "memory/memory.limit_in_bytes",
            "memory/memory.usage_in_bytes",
            "inactive_file 4096\ntotal_inactive_file 805306368\n",
        ),
    ],
    ids=["version 2", "version 1"],
)
def test_cached_files_of_a_container_are_free_memory(
    tmp_path: Path, limit: str, usage: str, stat: str
) -> None:
    groups = Path("sys/fs/cgroup")
    files = {limit: "1073741824\n", usage: "1073741824\n"}
    files[str(Path(usage).with_name("memory.stat"))] = stat
    write(tmp_path, {"proc/meminfo": MEMINFO, **{f"{groups / k}": v for k, v in files.items()}})
    assert memory_mib(tmp_path) == (1024.0, 768.0)


def test_a_missing_provider_fails_with_a_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(providers, "installed_providers", lambda: ("coreml",))
    (result,) = examine_providers()
    assert not result.works
    assert "fallback to CPU EP has been explicitly disabled" in result.reason


def test_the_lowest_versions_are_those_for_this_python() -> None:
    requirements = [
        "numpy>=2.1",
        'laspy[lazrs]>=2.5; extra == "lidar"',
        'pyorbbecsdk2<2.1,>=2.0.15; python_version < "3.12" and extra == "orbbec"',
        'pyorbbecsdk2>=2.1; python_version >= "3.12" and extra == "orbbec"',
    ]
    always = {"numpy": "2.1", "laspy": "2.5"}
    for python, orbbec in (((3, 11), "2.0.15"), ((3, 12), "2.1"), ((3, 13), "2.1")):
        assert minimum_versions(requirements, python) == {**always, "pyorbbecsdk2": orbbec}


def test_a_library_that_cannot_be_imported_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, {"cv2.py": "raise ImportError('libGL.so.1: cannot open shared object file')"})
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert import_error("cv2") == "ImportError: libGL.so.1: cannot open shared object file"
    assert import_error("json") == ""
