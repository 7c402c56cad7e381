"""Policies in processes of their own: the harness's side, the other side, and the messages between them."""
