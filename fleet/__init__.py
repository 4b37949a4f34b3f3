"""The old name of `basetree.jobs`, which goes on for one version with a warning."""

import basetree.jobs
from basetree.deprecation import moved_names

__all__: list[str] = []

__getattr__ = moved_names(
    __name__,
    {name: f"basetree.jobs.{name}" for name in basetree.jobs.__all__}
    | {
        "FleetError": "basetree.errors.InputError",
        "MissingEngine": "basetree.errors.MissingPackage",
    },
)
