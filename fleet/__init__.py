"""The old name of `basetree.jobs`, which goes on for one version with a warning."""

from basetree.deprecation import moved_names

__all__: list[str] = []

_JOBS = (
    "Job",
    "JobError",
    "LocalStore",
    "MergedParts",
    "Progress",
    "Shard",
    "Start",
    "Store",
    "StoreError",
    "Worker",
    "copy_folder",
    "fetch",
    "is_url",
    "open_store",
    "read_manifests",
    "run_shard",
    "write_manifest",
)
__getattr__ = moved_names(
    __name__,
    {name: f"basetree.jobs.{name}" for name in _JOBS}
    | {
        "FleetError": "basetree.errors.InputError",
        "MissingEngine": "basetree.errors.MissingPackage",
    },
)
