"""What can be made wrong with the virtual bench, and when."""
