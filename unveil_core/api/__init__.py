"""Python's face: runs by keywords, and a workspace as frames, objects, scenes and exports.

Nothing here computes: it hands on to the packages below, and loads what a call needs when it is made.
"""
