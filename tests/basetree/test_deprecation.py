"""Old import paths go on for one version, with a warning that names the new one."""

from __future__ import annotations

import importlib

import pytest

import basetree.errors
import basetree.jobs
from basetree.deprecation import moved_names

OLD_NAMES = {
    "calib.CalibError": basetree.errors.InputError,
    "calib.set_limits": basetree.files.set_limits,
    "calib.errors.CalibError": basetree.errors.InputError,
    "edgetree.errors.MissingDependency": basetree.errors.MissingPackage,
    "perceptree.errors.PerceptreeError": basetree.errors.InputError,
    "edgetree.MissingDependency": basetree.errors.MissingPackage,
    "fleet.Job": basetree.jobs.Job,
    "fleet.FleetError": basetree.errors.InputError,
    "perceptree.PerceptreeError": basetree.errors.InputError,
    "perceptree.SettingsError": basetree.errors.SettingsError,
}


@pytest.mark.parametrize("old", OLD_NAMES)
def test_an_old_name_still_works_and_says_the_new_one(old: str) -> None:
    module, _, name = old.rpartition(".")
    with pytest.warns(DeprecationWarning, match=rf"{old} is basetree\.\S+ now"):
        found = getattr(importlib.import_module(module), name)
    assert found is OLD_NAMES[old]


def test_other_names_are_unknown() -> None:
    with pytest.raises(AttributeError, match="module 'old' has no attribute 'nothing'"):
        moved_names("old", {"something": "os.path"})("nothing")
