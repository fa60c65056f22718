"""The plug-in comes with the installed package; a checkout that is only on the path takes the fixture from here."""

from faultlab.pytest_plugin import bench, pytest_configure

__all__ = ["bench", "pytest_configure"]
