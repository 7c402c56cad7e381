"""CasADi functions as compiled C code: a cache of libraries on disk and a cache of objects in memory."""
