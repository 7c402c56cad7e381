"""Evaluate policies; `python evaluate.py --help` says how."""

import sys

from agents.commands.evaluate import main

if __name__ == "__main__":
    sys.exit(main())
