"""The ring in shared memory through which the scan hands records to the supervisor, and the file they end in."""
