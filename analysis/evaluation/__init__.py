"""The evaluation: a trace, its method and the metrics wanted in; values with uncertainty, limits and a verdict out."""
