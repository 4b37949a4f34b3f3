"""Run all examinations, one after the other so that they do not disturb the speed test.

Modules that import a library that may be broken are imported only after that library was checked.
"""

from __future__ import annotations

from typing import Final

from edgetree.doctor.findings import Findings, ModelFile, Speed
from edgetree.doctor.libraries import examine_libraries, examine_video
from edgetree.doctor.machine import examine_machine
from edgetree.runtime.providers import CPU, OPENVINO

_PROBE_S: Final = 0.5


def examine() -> Findings:
    """Examine this machine, which takes a few seconds."""
    machine = examine_machine()  # first, as the other examinations keep cores busy
    libraries = examine_libraries()
    video = {} if "cv2" in libraries.import_errors else examine_video()
    if {"numpy", "onnxruntime"} & libraries.import_errors.keys():
        return Findings(machine, libraries, (), None, video)
    from edgetree.doctor.providers import examine_providers

    providers = examine_providers()
    runs = any(provider.works for provider in providers) and "cv2" not in libraries.import_errors
    openvino = any(provider.works and provider.name == OPENVINO for provider in providers)
    speed = probe_speed(openvino=openvino) if runs else None
    return Findings(machine, libraries, providers, speed, video, *examine_models())


def probe_speed(duration_s: float = _PROBE_S, *, openvino: bool = False) -> Speed:
    """Measure the speed of `edge-n-rgb`, for `duration_s` on one thread and on all.

    Args:
        duration_s: Time of each measurement.
        openvino: Whether to measure the provider openvino, too.
    """
    from edgetree.bench.speed import bench_detector
    from edgetree.runtime import TreeDetector, default_model
    from edgetree.runtime.session import usable_cores
    from edgetree.samples import sample_frames

    image = sample_frames()[0].image()
    threads = usable_cores()

    def fps(count: int, provider: str = CPU) -> float:
        detector = TreeDetector.load(
            default_model("edge-n-rgb"), threads=count, provider=provider, strict=False
        )
        return bench_detector(detector, [image], duration_s=duration_s).fps

    one = fps(1)
    every = one if threads == 1 else fps(threads)
    return Speed(threads, one, every, fps(threads, OPENVINO) if openvino else None)


def examine_models() -> tuple[tuple[ModelFile, ...], tuple[str, ...]]:
    """The models of `edgetree.catalogue.known_models`, and why others cannot be read.

    They have their hashes and signed versions; signatures are not checked.
    """
    from basetree.errors import InputError
    from basetree.files.reading import file_sha256
    from edgetree.catalogue import known_models
    from edgetree.errors import SignatureError
    from edgetree.signing.json_files import read_small_text
    from edgetree.signing.verify import parse_signature, signature_file

    found, faults = [], []
    try:
        known = known_models()
    except InputError as error:  # a folder in EDGETREE_MODELS does not exist
        return (), (str(error),)
    for model in known:
        try:
            signature = read_small_text(signature_file(model.path), "a signature")
            version = parse_signature(signature.encode()).version
        except SignatureError:
            version = None
        try:
            sha256 = file_sha256(model.path)
        except OSError as error:
            faults.append(
                f"model {model.path} cannot be read ({error.strerror}): repair or remove it"
            )
        else:
            found.append(ModelFile(model.name, str(model.path), sha256, version))
    return tuple(found), tuple(faults)
