"""Results of evaluations: in memory, and as folders that are read, checked and merged."""
