"""Files, processes, threads and command lines: what the suite asks of the operating system."""
