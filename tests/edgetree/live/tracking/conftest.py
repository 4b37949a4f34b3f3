"""Fixtures of the tests of tracking."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest


def _load(name: str) -> None:
    """Load a module that lies beside the tests."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)


_load("simulated_stand")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
