"""What a technician sees of a bench: inputs, outputs, interlocks, alarms, the way back, and what has changed."""
