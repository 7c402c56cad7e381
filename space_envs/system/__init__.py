"""Interface to the operating system: files, processes, threads and command lines."""
