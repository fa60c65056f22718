"""What the trace says: a torque-angle trace in, metrics with limits and a verdict out. Knows no machine.

The way of a sample goes through the rooms from left to right, and each imports those to its left only:
trace ← torque_ratio ← loop ← metrics ← uncertainty ← validity ← evaluation. `evaluation.pipeline.analyse` is the whole
way, `loop.measured.measure` the way up to the loops. Beside them stand `line` (statistics of a production line),
`models` (models of a reducer) and `studies`.
"""
