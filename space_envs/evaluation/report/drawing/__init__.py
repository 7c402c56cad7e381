"""Drawing with matplotlib for pages: panels, labels, ticks and the looks of policies."""
