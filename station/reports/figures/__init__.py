"""Pictures of a run: loop, residuals, stiffness, time and timing."""
