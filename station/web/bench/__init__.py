"""What a technician sees of a bench: inputs, outputs, interlocks, alarms, the recovery, and what has changed."""
