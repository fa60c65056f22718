"""Pages of recipes: all revisions, the editor of one, and what changed between two."""
