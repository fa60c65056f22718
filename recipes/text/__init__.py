"""From a YAML file to values with a place: what is wrong is said with line and column."""
