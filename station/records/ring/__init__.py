"""The ring in shared memory through which the scan hands its records to the desk, and the file that they end in."""
