"""How a run that was left or cut short is brought to its end, and a wound-up unit to rest."""
