"""An evaluation that was found to be valid: its time, its run, faults of policies."""
