"""The made-up live results, which the tests of `edgetree.live` use too."""

from __future__ import annotations

import importlib.util
from pathlib import Path

_SPEC = importlib.util.spec_from_file_location(
    "live_results", Path(__file__).parents[1] / "live" / "conftest.py"
)
assert _SPEC is not None
assert _SPEC.loader is not None
_LIVE = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_LIVE)

live_result = _LIVE.live_result
sample_results = _LIVE.sample_results
