"""Pages of the registered ids."""
