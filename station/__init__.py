"""What people touch: command line, run supervisor, records, reports."""
