"""CasADi functions as compiled C code, with one cache."""
