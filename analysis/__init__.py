"""What the trace says: a torque-angle trace in, metrics with limits and a verdict out. Knows no machine."""
