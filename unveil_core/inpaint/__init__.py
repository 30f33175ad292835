"""Fills what the removed objects hid.

Order of work (``emptied``): ``by_stretch`` reads the chart of the ground in street coordinates (``chart``), finds the sun and the
shadows (``light``), removes shadows and fills the chart (``fill``); ``upright`` completes facades (``facade``). What is still
missing is inpainted frame by frame, keyframes first (``cleaning``, ``frames``, ``single_image``).
"""
