"""What a run gives the store: its own rows, those that it shares with other runs, and where the archive has it."""
