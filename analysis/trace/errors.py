"""The one exception of this package.

AnalysisError
    What cannot be read, is missing, or cannot be evaluated. Its text says what, where, what was found, what is needed
    and what to do next.
"""


class AnalysisError(Exception):
    """A trace, a method or a wanted metric that cannot be worked with, in words for the person who asked."""
