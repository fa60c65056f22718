"""Statistics of a line: values of many runs in; repeatability, capability, gage study and trends of it out."""
