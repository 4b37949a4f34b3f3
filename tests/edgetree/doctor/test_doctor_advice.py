"""Advice for findings of different machines."""

import dataclasses

import pytest

from edgetree.doctor import (
    Findings,
    Libraries,
    Machine,
    ProviderResult,
    Speed,
    advise,
)
from edgetree.doctor.libraries import minimum_versions

MACHINE = Machine(
    system="Linux x86_64",
    architecture="x86_64",
    processor="a processor",
    instructions=("avx2", "avx512", "avx512_vnni"),
    cores=4,
    usable_cores=4,
    core_quota=None,
    busy_cores=0.1,
    memory_mib=16000.0,
    free_memory_mib=12000.0,
    has_nvidia_gpu=False,
)
VERSIONS = {
    "numpy": "2.4.6",
    "opencv-python-headless": "5.0.0.93",
    "onnxruntime": "1.31.1",
    "torch": "2.15.0",
    "torchvision": "0.29.2",
    "timm": "1.0",
    "pycocotools": "2.0",
    "safetensors": "0.5",
    "onnx": "1.23",
    "onnxscript": "0.7",
    "numba": "0.68",
}
LIBRARIES = Libraries(
    "3.11.7", VERSIONS, {"numpy": "2.1", "onnxruntime": "1.21"}, torch_needed="2.15.0"
)
CPU = ProviderResult("cpu", True)
CUDA = ProviderResult("cuda", True)
OPENVINO = ProviderResult("openvino", True)
BROKEN_CUDA = ProviderResult("cuda", False, "libcudnn.so.9 is not there")
HEALTHY = Findings(MACHINE, LIBRARIES, (CPU,), Speed(4, 20.0, 60.0))


def said(level: str, findings: Findings) -> list[str]:
    return [item.text for item in advise(findings) if item.level == level]


def with_machine(**changes: object) -> Findings:
    return dataclasses.replace(HEALTHY, machine=dataclasses.replace(MACHINE, **changes))


def with_libraries(**changes: object) -> Findings:
    return dataclasses.replace(HEALTHY, libraries=dataclasses.replace(LIBRARIES, **changes))


def with_versions(**versions: str) -> Findings:
    more = {name.replace("_", "-"): version for name, version in versions.items()}
    return with_libraries(versions=VERSIONS | more)


def test_a_healthy_machine_gets_only_advice_about_precision() -> None:
    (advice,) = advise(HEALTHY)
    assert advice.level == "advice"
    assert "--precision int8" in advice.text


BROKEN = {
    "two builds of onnxruntime": (
        with_versions(onnxruntime_gpu="1.31.1"),
        "onnxruntime and onnxruntime-gpu are installed",
    ),
    "OpenVINO's beside the plain one": (
        with_versions(onnxruntime_openvino="1.24.1"),
        "onnxruntime and onnxruntime-openvino are installed",
    ),
    "DirectML's beside the plain one": (
        with_versions(onnxruntime_directml="1.24.1"),
        "onnxruntime and onnxruntime-directml are installed",
    ),
    "two builds of OpenCV": (
        with_versions(opencv_python="5.0.0.93"),
        "opencv-python and opencv-python-headless are installed",
    ),
    "an old numpy": (with_versions(numpy="2.0.2"), "numpy is 2.0.2: expected 2.1 or newer"),
    "torchvision of another torch": (
        with_versions(torch="2.14.1+cpu"),
        "torchvision 0.29.2 was built for torch 2.15.0, and torch is 2.14.1+cpu",
    ),
    "a torchvision that does not load": (
        with_libraries(import_errors={"torchvision": "operator torchvision::nms does not exist"}),
        "torchvision cannot be imported (operator torchvision::nms does not exist): install torch",
    ),
    "an OpenCV without display libraries": (
        with_libraries(import_errors={"cv2": "libGL.so.1: cannot open"}),
        "cv2 cannot be imported (libGL.so.1: cannot open): install opencv-python-headless",
    ),
    "no onnxruntime": (
        with_libraries(versions={"numpy": "2.4.6"}),
        'onnxruntime is not installed: pip install ".[cpu]" in the project\'s folder',
    ),
    "no provider": (
        dataclasses.replace(HEALTHY, providers=(BROKEN_CUDA,)),
        "no provider of onnxruntime works",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_libraries_are_named_with_a_remedy(case: str) -> None:
    findings, expected = BROKEN[case]
    (text,) = said("broken", findings)
    assert expected in text
    assert advise(findings)[0].level == "broken", "the worst comes first"


def test_matching_versions_are_not_broken() -> None:
    for versions in ({"torch": "2.15.0+cu130"}, {"numpy": "2.1.0rc1"}, {"numpy": "2.10"}):
        assert said("broken", with_versions(**versions)) == []
    assert said("broken", with_libraries(minima={"numpy": "2.4.6.0"})) == []


def test_minima_are_read_from_requirements() -> None:
    lines = ["numpy>=2.1", 'onnxruntime>=1.21; extra == "cpu"', "edgetree[cpu]", "Foo (>=1.0)"]
    assert minimum_versions(lines) == {"numpy": "2.1", "onnxruntime": "1.21", "foo": "1.0"}


BEWARE = {
    "no VNNI": (with_machine(instructions=("avx2", "avx512")), "INT8 sums can saturate"),
    "an old ARM": (
        with_machine(architecture="aarch64", instructions=()),
        "no dot product instructions",
    ),
    "a container's quota": (
        with_machine(core_quota=1.5),
        "the time of 1.5 cores, but sees 4: pass --threads 1",
    ),
    "busy cores": (with_machine(busy_cores=2.2), "2.2 of 4 cores were busy"),
    "little memory": (with_machine(free_memory_mib=700.0), "700 MiB of memory are free"),
    "a provider that is offered and fails": (
        dataclasses.replace(HEALTHY, providers=(BROKEN_CUDA, CPU)),
        "provider cuda is installed but does not work (libcudnn.so.9 is not there)",
    ),
}


@pytest.mark.parametrize("case", BEWARE)
def test_warnings_do_not_count_as_broken(case: str) -> None:
    findings, expected = BEWARE[case]
    (text,) = said("beware", findings)
    assert expected in text
    assert said("broken", findings) == []


def test_a_cpu_without_avx2_gets_a_warning() -> None:
    assert any("no AVX2" in text for text in said("beware", with_machine(instructions=())))


ADVICE = {
    "VNNI of the short vectors": (with_machine(instructions=("avx2", "avx_vnni")), "int8"),
    "an ARM with dot products": (
        with_machine(architecture="arm64", instructions=("dotprod",)),
        "--precision int8",
    ),
    "instructions not known": (with_machine(instructions=None), "it is not known whether"),
    "an unused GPU": (with_machine(has_nvidia_gpu=True), "the NVIDIA GPU is not used"),
    "a GPU that works": (
        dataclasses.replace(with_machine(has_nvidia_gpu=True), providers=(CUDA, CPU)),
        "edgetree bench --provider cuda",
    ),
    "OpenVINO is faster": (
        dataclasses.replace(
            HEALTHY, providers=(OPENVINO, CPU), speed=Speed(4, 20.0, 60.0, fps_openvino=72.0)
        ),
        "at 1.20 times the speed of cpu: pass --provider openvino",
    ),
    "OpenVINO is not faster": (
        dataclasses.replace(
            HEALTHY, providers=(OPENVINO, CPU), speed=Speed(4, 20.0, 60.0, fps_openvino=61.0)
        ),
        "at 1.02 times the speed of cpu: stay with cpu",
    ),
    "threads that do not help": (
        dataclasses.replace(HEALTHY, speed=Speed(4, 20.0, 21.0)),
        "4 threads are not faster than one here: pass --threads 1",
    ),
    "no training stack": (
        with_libraries(versions={"numpy": "2.4.6", "onnxruntime": "1.31.1"}),
        'pip install ".[train,export,sim]"',
    ),
}


@pytest.mark.parametrize("case", ADVICE)
def test_advice_names_the_next_step(case: str) -> None:
    findings, expected = ADVICE[case]
    assert any(expected in text for text in said("advice", findings)), said("advice", findings)
    assert said("broken", findings) == []


def test_a_machine_with_a_gpu_is_advised_to_install_the_gpu_build() -> None:
    findings = dataclasses.replace(
        with_machine(has_nvidia_gpu=True),
        libraries=dataclasses.replace(LIBRARIES, versions={"numpy": "2.4.6"}),
    )
    assert said("broken", findings) == [
        'onnxruntime is not installed: pip install ".[gpu]" in the project\'s folder'
    ]
