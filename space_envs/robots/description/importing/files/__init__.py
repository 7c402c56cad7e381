"""URDF and MJCF files, read into one form."""
