"""Train a policy; `python train.py --help` says how."""

from agents.commands.train import main

if __name__ == "__main__":
    raise SystemExit(main())
