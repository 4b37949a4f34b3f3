"""Clock, temperature and energy of the processor, where the system lets them be read (Linux)."""

from __future__ import annotations

import re
from pathlib import Path
from statistics import fmean
from typing import Any

_CPU_ZONES = re.compile(r"x86_pkg_temp|cpu|soc|acpitz|coretemp|k10temp", re.IGNORECASE)
_MICRO = 1e-6


def sensor_values(root: Path = Path("/")) -> dict[str, float | None]:
    """`clock_mhz` and `temperature_c` now; None where the system does not tell.

    Args:
        root: The folder that contains `proc` and `sys`; another one in tests.
    """
    return {"clock_mhz": clock_mhz(root), "temperature_c": temperature_c(root)}


def clock_mhz(root: Path = Path("/")) -> float | None:
    """Mean clock of the processor's cores, MHz; in virtual machines the nominal one."""
    files = sorted(root.glob("sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_cur_freq"))
    clocks = [value / 1000 for path in files if (value := _number(path)) is not None]
    if not clocks:
        lines = re.findall(
            r"^cpu MHz\s*:\s*([\d.]+)", _text(root / "proc/cpuinfo") or "", flags=re.MULTILINE
        )
        clocks = [float(line) for line in lines]
    return round(fmean(clocks), 1) if clocks else None


def temperature_c(root: Path = Path("/")) -> float | None:
    """Highest temperature of the processor's sensors, degrees Celsius."""
    found = []
    for zone in root.glob("sys/class/thermal/thermal_zone*"):
        if _CPU_ZONES.search(_text(zone / "type") or ""):
            found.append(_number(zone / "temp"))
    for device in root.glob("sys/class/hwmon/hwmon*"):
        if _CPU_ZONES.search(_text(device / "name") or ""):
            found += [_number(path) for path in device.glob("temp*_input")]
    known = [value / 1000 for value in found if value is not None]
    return round(max(known), 1) if known else None


class EnergyCounter:
    """Energy that the processor packages have used since this object was made.

    The counters are those of RAPL in /sys/class/powercap, which only root can read on most systems.

    Args:
        root: The folder that contains `sys`; another one in tests.
    """

    def __init__(self, root: Path = Path("/")) -> None:
        packages = sorted(root.glob("sys/class/powercap/intel-rapl:[0-9]"))
        self._start = {
            package: start
            for package in packages
            if (start := _number(package / "energy_uj")) is not None
        }

    def joules(self) -> float | None:
        """Joules so far; None if there is no counter. Counters that wrapped once are understood."""
        total: float | None = None
        for package, start in self._start.items():
            now = _number(package / "energy_uj")
            if now is None:
                return None
            if now < start:
                now += _number(package / "max_energy_range_uj") or 0.0
            total = (total or 0.0) + (now - start) * _MICRO
        return total


def _number(path: Path) -> float | None:
    text: Any = _text(path)
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None
