"""Examine the machine and its libraries, and give advice."""

from edgetree.doctor.advice import Advice, advise
from edgetree.doctor.examine import examine
from edgetree.doctor.findings import (
    Findings,
    Libraries,
    Machine,
    ModelFile,
    ProviderResult,
    Speed,
)

__all__ = [
    "Advice",
    "Findings",
    "Libraries",
    "Machine",
    "ModelFile",
    "ProviderResult",
    "Speed",
    "advise",
    "examine",
]
