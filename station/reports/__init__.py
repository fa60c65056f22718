"""What people see of a result: report, pictures, tables and words."""
