"""Fills what the removed objects hid.

Order of work (``pipeline.steps.inpaint``): ``street_scene`` reads the chart of the ground in street coordinates (``chart``), finds
the sun and the shadows (``light``), removes shadows and fills the chart (``fill``); then it completes facades and poles
(``facade``). What is still missing is inpainted frame by frame, keyframes first (``frames``, ``single_image``).
"""
