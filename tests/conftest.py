"""Settings of the whole suite."""

import os

from hypothesis import settings

# Speeds of shared machines vary too much for deadlines. In CI the same examples are drawn every time, so
# that a red run can be repeated; at a desk new ones are looked for.
settings.register_profile("desk", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "desk")
