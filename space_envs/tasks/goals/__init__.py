"""Goals of the tasks: how they are drawn from seeds, and the motions that prove them reachable."""
