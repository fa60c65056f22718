"""The trace: a file or the samples of a run in; channels over time, the segment of each sample, and the runs out.

Beside it stands what every other room needs: units, figures of documents in those units, and the one exception.
"""
