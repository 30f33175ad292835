"""Shots: a camera path of a matchmove beside plates."""
