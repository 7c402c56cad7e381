"""Many runs of one command: which ones, and how they are spread over processes."""
