"""The papers' figures, tables and claims from the project's own runs, a package per paper.

`python -m reproduce PAPER` writes a page; what is shared by the papers lies here: random cases that can be
stopped and resumed, claims and how often they hold, figures, animations, and the page itself.
"""
