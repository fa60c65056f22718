"""The loop: a trace and its method in; stage by stage, branches of each cycle as corrected and fitted curves out."""
