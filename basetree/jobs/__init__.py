"""Work on more than one machine: shards, stores of results, and the cluster engine Ray.

A job is work on many frames, cut into units such as scenes or blocks of frames. The result of a
unit is one part, a file in a store. A part is written when its unit is finished, so that a stopped
job goes on where it was, and two workers may do the same unit without harm. Merging the parts gives
what one machine gives.

This package knows nothing about trees: `perceptree` and `edgetree` say what their units are.
"""

from basetree.jobs.errors import JobError, StoreError
from basetree.jobs.job import Job
from basetree.jobs.manifests import MergedParts, read_manifests, write_manifest
from basetree.jobs.progress import Progress
from basetree.jobs.running import Start, Worker, run_shard
from basetree.jobs.shard import Shard
from basetree.jobs.stores import LocalStore, Store, copy_folder, fetch, is_url, open_store

__all__ = [
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
]
