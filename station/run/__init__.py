"""A run from its start to its conclusion: supervisor, child processes, virtual time, recovery, timing."""
