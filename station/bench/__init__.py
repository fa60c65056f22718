"""From files to a bench: what is asked for, what drivers and virtual bench are told, and their processes."""
