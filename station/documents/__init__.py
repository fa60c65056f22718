"""What the JSON files of a run say, as classes: each is written and read here and nowhere else."""
