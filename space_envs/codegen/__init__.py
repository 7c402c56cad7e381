"""CasADi functions as compiled C code: one cache of libraries on disk, one of what was built in memory."""
