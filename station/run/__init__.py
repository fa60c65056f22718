"""A run from its start to its conclusion: desk, child processes, virtual time, recovery, timing."""
