"""Parts of `train.py`: its options, many runs of one command, and shipping a trained policy."""
