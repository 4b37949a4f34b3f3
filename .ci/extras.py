"""Whether every extra can be installed: `uv` looks for wheels for each Python and platform.

Linux is tried with every Python, the other platforms with the oldest and the newest.

    python .ci/extras.py            all
    python .ci/extras.py orbbec     some

Exit code 1 if an extra cannot be resolved where it should be, or can be where this file says not.
Needs a package index; without one, or without uv, it says so and ends with 0.
"""

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
LINUX, ARM, WINDOWS, MAC = (
    "x86_64-manylinux_2_28",
    "aarch64-manylinux_2_28",
    "x86_64-pc-windows-msvc",
    "aarch64-apple-darwin",
)
TRIED = [(python, LINUX) for python in PYTHONS] + [
    (python, platform) for platform in (ARM, WINDOWS, MAC) for python in (PYTHONS[0], PYTHONS[-1])
]
# Where an extra cannot be installed, as its maker builds no wheels for it.
MISSING: dict[str, set[tuple[str, str]]] = {
    "gpu": {(python, name) for python in PYTHONS for name in (ARM, MAC)},
    "openvino": {(python, name) for python in PYTHONS for name in (ARM, MAC)},
    "realsense": {(python, MAC) for python in PYTHONS} | {("3.11", ARM), ("3.13", ARM)},
    "orbbec": {("3.11", MAC)},
    "directml": {(python, name) for python in PYTHONS for name in (LINUX, ARM, MAC)},
}
NOT_TRIED = {"dev", "docs"}  # what they need is pinned in requirements/dev.txt


def extras() -> list[str]:
    """The extras of pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    return [name for name in project["optional-dependencies"] if name not in NOT_TRIED]


def fault(uv: str, extra: str, python: str, platform: str) -> str | None:
    """Why an extra cannot be resolved, in a line; None if it can."""
    command = [uv, "pip", "compile", "pyproject.toml", "--extra", extra, "--quiet"]
    command += ["--python-version", python, "--python-platform", platform]
    command += ["--only-binary", ":all:", "--no-header"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return None if done.returncode == 0 else " ".join(done.stderr.split())[:400]


def main(names: list[str]) -> int:
    """Try them; returns the exit code."""
    uv = shutil.which("uv", path=str(Path(sys.executable).parent)) or shutil.which("uv")
    if uv is None:
        sys.stdout.write("extras: there is no program uv: not tried\n")
        return 0
    probe = [uv, "pip", "compile", "-", "--quiet", "--no-header"]
    done = subprocess.run(
        probe, input="numpy", cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode:
        told = " ".join(done.stderr.split())[:400]
        sys.stdout.write(f"extras: no package index can be reached: not tried ({told})\n")
        return 0
    wrong = 0
    for extra in names or extras():
        for python, platform in TRIED:
            found = fault(uv, extra, python, platform)
            expected = (python, platform) not in MISSING.get(extra, set())
            if (found is None) != expected:
                wrong += 1
                told = found or "it can be, and .ci/extras.py says that it cannot"
                sys.stdout.write(f"extra {extra}, Python {python}, {platform}: {told}\n")
        sys.stdout.write(f"extra {extra}: tried\n")
        sys.stdout.flush()
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
