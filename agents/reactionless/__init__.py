"""Reactionless capture by two arms: planners that leave the attitude of the base alone (shah2013).

Importing this package loads nothing heavy; its modules need CasADi.
"""
