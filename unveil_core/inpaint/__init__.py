"""Fills what the removed objects hid.

Order of work (``street_scene``): the ground first, in street coordinates (``chart``, ``light``, ``fill``); then facades and poles
(``facade``); last what is left, frame by frame (``single_image``, ``frames``).
"""
