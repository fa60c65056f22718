"""Commands that measure, and those that bring a run to its end: run, check, resume, recover, conclude."""
