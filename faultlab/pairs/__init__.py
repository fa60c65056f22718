"""Two faults at once, drawn by chance, held against a run without them."""
