"""Read cores, memory and instruction sets from /proc and /sys; elsewhere what Python provides."""

from __future__ import annotations

import os
import platform
import re
import shutil
from pathlib import Path
from typing import Final

from edgetree.doctor.findings import Machine
from edgetree.runtime.session import usable_cores

# Flags in /proc/cpuinfo and the names of the instruction sets.
_INSTRUCTIONS: Final = {
    "avx2": "avx2",
    "avx512f": "avx512",
    "avx512_vnni": "avx512_vnni",
    "avx_vnni": "avx_vnni",
    "amx_int8": "amx_int8",
    "asimddp": "dotprod",
    "i8mm": "i8mm",
}
_UNLIMITED_BYTES: Final = 1 << 60


def examine_machine(root: Path = Path("/")) -> Machine:
    """Examine this machine.

    Args:
        root: The folder that contains `proc` and `sys`; another one in tests.
    """
    total, free = memory_mib(root)
    cpuinfo = _read(root / "proc/cpuinfo") or ""
    name = re.search(r"^model name\s*:\s*(.+)$", cpuinfo, flags=re.MULTILINE)
    driver = (root / "proc/driver/nvidia/version").exists() or shutil.which("nvidia-smi")
    return Machine(
        system=f"{platform.system()} {platform.machine()}",
        architecture=platform.machine().lower(),
        processor=name[1].strip() if name else _board(root) or platform.processor() or None,
        instructions=instruction_sets(cpuinfo),
        cores=os.cpu_count() or 1,
        usable_cores=usable_cores(),
        core_quota=core_quota(root),
        busy_cores=os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        memory_mib=total,
        free_memory_mib=free,
        has_nvidia_gpu=bool(driver),
    )


def _board(root: Path) -> str | None:
    """The name of a board whose processor has none, as of ARM; None if not known."""
    return (_read(root / "proc/device-tree/model") or "").strip("\0 \n") or None


def instruction_sets(cpuinfo: str) -> tuple[str, ...] | None:
    """The instruction sets that speed up networks.

    Args:
        cpuinfo: Content of /proc/cpuinfo.

    Returns:
        Their names; None if `cpuinfo` lists no flags.
    """
    flags = re.search(r"^(?:flags|Features)\s*:(.*)$", cpuinfo, flags=re.MULTILINE)
    if flags is None:
        return None
    found = set(flags[1].split())
    return tuple(name for flag, name in _INSTRUCTIONS.items() if flag in found)


def core_quota(root: Path) -> float | None:
    """CPU time limit of this process's control group, in cores; None if not limited."""
    quotas = []
    for folder in _control_groups(root, "cpu"):
        words = (_read(folder / "cpu.max") or "").split()
        if not words:
            names = ("cpu.cfs_quota_us", "cpu.cfs_period_us")
            words = [(_read(folder / name) or "").strip() for name in names]
        if all(word.isdigit() for word in words):  # "max" and "-1" mean no limit
            quotas.append(int(words[0]) / int(words[1]))
    return min(quotas, default=None)


def memory_mib(root: Path) -> tuple[float | None, float | None]:
    """Total and available memory in MiB, within the limits of a container; None if not known."""
    lines = (_read(root / "proc/meminfo") or "").splitlines()
    sizes = {line.partition(":")[0]: float(line.split()[1]) / 1024 for line in lines if line}
    total, free = sizes.get("MemTotal"), sizes.get("MemAvailable")
    for folder in _control_groups(root, "memory"):
        for limit, usage, cache in (
            ("memory.max", "memory.current", "inactive_file"),
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
        ):
            text, used = _read(folder / limit), _read(folder / usage)
            if not (text and used and text.strip().isdigit()) or int(text) > _UNLIMITED_BYTES:
                continue
            allowed = int(text) / 1024**2
            total = allowed if total is None else min(total, allowed)
            left = allowed - max(int(used) - _cached_bytes(folder, cache), 0) / 1024**2
            free = left if free is None else min(free, left)
    return total, free


def _cached_bytes(folder: Path, name: str) -> int:
    """Files in a control group's memory that the system drops when memory is needed."""
    found = re.search(rf"^{name} (\d+)$", _read(folder / "memory.stat") or "", re.MULTILINE)
    return int(found[1]) if found else 0


def _control_groups(root: Path, controller: str) -> list[Path]:
    """Folders of this process's control group and its parents, for cgroup versions 1 and 2."""
    base = root / "sys/fs/cgroup"
    folders = {base: None, base / controller: None}
    for line in (_read(root / "proc/self/cgroup") or "").splitlines():
        _, controllers, inside = line.split(":", 2)
        if controllers and controller not in controllers.split(","):
            continue
        top = base / controller if controllers else base
        own = top / inside.strip("/")
        folders |= dict.fromkeys(part for part in (own, *own.parents) if part.is_relative_to(top))
    return list(folders)


def _read(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
