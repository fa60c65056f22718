"""The plug-in comes with the installed package; a checkout that is only on the path takes the fixture from here."""

from faultlab.pytest_plugin import lostmotion_bench, pytest_configure

__all__ = ["lostmotion_bench", "pytest_configure"]
