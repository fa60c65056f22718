"""Commands on many runs of one metric: capability, units, master part, gage and repeatability."""
