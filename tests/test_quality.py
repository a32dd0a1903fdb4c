"""Warnings of poor results point at the code of the user."""

from __future__ import annotations

import inspect

import pytest

import phaseatlas as pa
from phaseatlas.quality import warn

DEEP = "def work():\n    helper()\ndef helper():\n    warn('deep')\n"


def test_a_warning_points_at_its_caller():
    line = inspect.currentframe().f_lineno + 2
    with pytest.warns(pa.QualityWarning, match=r"^three flips$") as caught:
        warn("three flips")
    assert (caught[0].filename, caught[0].lineno) == (__file__, line)


def test_a_warning_from_inside_the_package_points_outside():
    # Code that lies in the folder of the package, however deep, is not what the user can change.
    scope = {"warn": warn}
    exec(compile(DEEP, pa.__file__.replace("__init__.py", "atlas/somewhere.py"), "exec"), scope)
    line = inspect.currentframe().f_lineno + 2
    with pytest.warns(pa.QualityWarning) as caught:
        scope["work"]()
    assert (caught[0].filename, caught[0].lineno) == (__file__, line)


def test_quality_is_a_runtime_warning():
    assert issubclass(pa.QualityWarning, RuntimeWarning)
